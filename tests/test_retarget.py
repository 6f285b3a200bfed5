"""Retargeting against what is known: directions of human limbs, limits, a pose that comes back, bodies kept apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import motions
import mujoco
import numpy as np
import pytest
from retargeted import CLIPS, RIGS, done, shown_at, sites, unit

from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton
from motiongen.rotation import Array, quat_conj, quat_mul
from retarget.collisions import collision_pairs
from retarget.model import load_model
from retarget.retarget import retarget
from retarget.rig import Rig, RigError, load_rig


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("clip", CLIPS)
def test_joint_limits_and_velocities_hold_in_every_frame(rig: str, clip: str) -> None:
    joints = load_rig(rig).joints
    trajectory = done(rig, clip)
    speed = np.abs(np.diff(trajectory.joint_pos, axis=0)) * trajectory.fps
    assert (trajectory.joint_pos >= [j.lower - 1e-6 for j in joints]).all()
    assert (trajectory.joint_pos <= [j.upper + 1e-6 for j in joints]).all()
    assert (speed <= [j.velocity + 1e-5 for j in joints]).all()


def test_flailing_does_reach_the_velocity_limit() -> None:
    speed = np.abs(np.diff(done("puppet", "flail").joint_pos, axis=0)).max(0) * 50
    limits = np.array([j.velocity for j in load_rig("puppet").joints])
    assert (speed > 0.95 * limits).sum() >= 2


@pytest.mark.parametrize("rig", RIGS)
def test_it_starts_and_ends_at_rest_in_the_nominal_pose(rig: str) -> None:
    description = load_rig(rig)
    trajectory = done(rig, "walk")
    nominal = description.pose_vector(description.nominal)
    assert trajectory.joint_pos[0] == pytest.approx(nominal)
    assert trajectory.joint_pos[-1] == pytest.approx(nominal, abs=0.01)
    assert np.abs(trajectory.joint_pos[1] - trajectory.joint_pos[0]).max() * 50 < 0.05
    assert trajectory.qpos[0, [0, 1, 3, 4, 5, 6]] == pytest.approx([0, 0, 1, 0, 0, 0], abs=2e-3)
    start = trajectory.labels[0].start_s
    assert start >= 0.5
    assert trajectory.duration - trajectory.labels[0].end_s >= 0.5 - 0.021
    assert (trajectory.labels[0].text, trajectory.source.generator) == ("walk forward", "synthetic")


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize(("clip", "up", "down"), [("wave", "right", "left"), ("wave left", "left", "right")])
def test_a_wave_lifts_the_right_hand_above_the_shoulder_and_not_the_other(
    rig: str, clip: str, up: str, down: str
) -> None:
    trajectory = done(rig, clip)
    z = sites(trajectory, f"{up}_hand", f"{up}_upper_arm", f"{down}_hand", f"{down}_upper_arm")[..., 2]
    middle = slice(shown_at(motions.wave(), trajectory, 1.2), shown_at(motions.wave(), trajectory, 2.8))
    assert (z[middle, 0] > z[middle, 1]).all()
    assert (z[:, 2] < z[:, 3]).all()


@pytest.mark.parametrize("rig", RIGS)
def test_left_and_right_are_mirror_images(rig: str) -> None:
    names = load_rig(rig).joint_names()
    left, right = done(rig, "wave left"), done(rig, "wave")
    for i, name in enumerate(names):
        if name.startswith("left"):
            other = right.joint_pos[:, names.index(name.replace("left", "right"))]
            assert np.abs(left.joint_pos[:, i] - other).max() < 0.02


@pytest.mark.parametrize(("rig", "degrees"), [("puppet", 12.0), ("humanoid", 6.0)])
@pytest.mark.parametrize("clip", ["wave", "squat", "walk"])
def test_limbs_point_where_the_human_s_do(rig: str, degrees: float, clip: str) -> None:
    """On the floor, at a speed that a servo can follow: walk and wave are slowed down for the puppet."""
    human = CLIPS[clip]() if clip != "walk" else motions.walk(0.4)
    if clip == "wave":
        label = replace(human.labels[0], end_s=human.labels[0].end_s / 0.8)
        human = replace(human, fps=0.8 * human.fps, labels=(label,))
    trajectory = retarget(human, load_rig(rig), mount="hung")
    body = human.positions()
    limbs = (("shoulder", "upper_arm", "elbow", "forearm"), ("elbow", "forearm", "wrist", "hand"))
    limbs += (("hip", "thigh", "knee", "shin"), ("knee", "shin", "ankle", "foot"))
    for seconds in (1.25, 1.6, 2.0, 2.4):
        frame, source = shown_at(human, trajectory, seconds), round(seconds * human.fps)
        for side in ("left", "right"):
            for top, top_body, end, end_body in limbs:
                joints = [human.skeleton.index(f"{side}_{j}") for j in (top, end)]
                wanted = unit(np.diff(body[source, joints], axis=0)[0])
                places = sites(trajectory, f"{side}_{top_body}", f"{side}_{end_body}")[frame]
                got = unit(np.diff(places, axis=0)[0])
                assert np.degrees(np.arccos(np.clip(wanted @ got, -1, 1))) < degrees, (side, end, seconds)


def test_a_pose_of_the_rig_shown_by_a_human_of_its_shape_comes_back() -> None:
    """Round trip: smooth random angles of the humanoid → a human with its joints → retargeting → the angles."""
    rig = load_rig("humanoid")
    model = load_model(rig)
    rng = np.random.default_rng(3)
    seconds, fps = 3.0, 50.0
    t = np.arange(round(seconds * fps) + 1) / fps
    names = rig.joint_names()
    angles = np.zeros((len(t), len(names)))
    for i, joint in enumerate(rig.joints):
        if joint.name.startswith(("abdomen", "chest")):
            continue  # two joints for one turn of the trunk: what comes back is another split
        middle, swing = 0.35 * joint.upper, 0.15 * (joint.upper - joint.lower)
        angles[:, i] = middle + swing * np.sin(rng.uniform(1, 3) * t + rng.uniform(0, 6))
    human = _shown_by_a_human(angles, rig, model, fps)
    trajectory = retarget(human, rig, mount="hung")
    error = []
    for second in np.arange(0.5, 2.5, 0.1):
        frame = shown_at(human, trajectory, second)
        near = range(frame - 1, frame + 2)  # the ramp shifts time by half a frame
        error.append(np.min([np.abs(trajectory.joint_pos[n] - angles[round(second * fps)]) for n in near], axis=0))
    worst = dict(zip(names, np.max(error, axis=0), strict=True))
    assert max(worst.values()) < 0.06, worst


def _shown_by_a_human(angles: Array, rig: Rig, model: mujoco.MjModel, fps: float) -> Motion:
    bodies = {"pelvis": "pelvis", "spine1": "pelvis", "spine2": "abdomen", "spine3": "chest", "neck": "chest"}
    bodies |= {"head": "head"}
    for side in ("left", "right"):
        bodies |= {f"{side}_hip": f"{side}_thigh", f"{side}_knee": f"{side}_shin", f"{side}_ankle": f"{side}_foot"}
        bodies |= {f"{side}_foot": f"{side}_foot", f"{side}_collar": "chest", f"{side}_shoulder": f"{side}_upper_arm"}
        bodies |= {f"{side}_elbow": f"{side}_forearm", f"{side}_wrist": f"{side}_forearm"}
    tips = {f"{s}_{j}": f"{s}_{site}" for s in ("left", "right") for j, site in (("foot", "toe"), ("wrist", "hand"))}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    at = [data.site(tips[j]).xpos if j in tips else data.body(bodies[j]).xpos for j in SMPL_JOINTS]
    offsets = np.array([at[i] - at[p] if p >= 0 else np.zeros(3) for i, p in enumerate(SMPL_PARENTS)])
    turn = np.empty((len(angles), len(SMPL_JOINTS), 4))
    for frame, q in enumerate(angles):
        data.qpos[7:] = q
        mujoco.mj_kinematics(model, data)
        turn[frame] = [data.body(bodies[j]).xquat for j in SMPL_JOINTS]
    local = turn.copy()
    for i, p in enumerate(SMPL_PARENTS):
        if p >= 0:
            local[:, i] = quat_mul(quat_conj(turn[:, p]), turn[:, i])
    root = np.tile([0.0, 0.0, rig.nominal.height + 0.2], (len(angles), 1))
    in_air = np.zeros((len(angles), 4), bool)
    labels = (Label(0.0, (len(angles) - 1) / fps, "round trip"),)
    return Motion(root, local, fps, Skeleton(SMPL_JOINTS, SMPL_PARENTS, offsets), labels, contacts=in_air)


def test_where_the_clip_begins_and_faces_does_not_matter() -> None:
    clip = motions.turned(motions.walk(), 2.0, np.array([3.0, -4.0, 0.0]))
    moved = retarget(clip, load_rig("humanoid"))
    assert moved.qpos == pytest.approx(done("humanoid", "walk").qpos, abs=1e-3)


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("clip", ["wave", "walk", "hands through the body"])
def test_bodies_keep_apart(rig: str, clip: str) -> None:
    trajectory = retarget(_hands_through_the_body(), load_rig(rig)) if clip not in CLIPS else done(rig, clip)
    model = load_model(load_rig(rig))
    data = mujoco.MjData(model)
    nearest = np.inf
    for q in trajectory.qpos:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        gaps = [mujoco.mj_geomDistance(model, data, a, b, 0.1, None) for a, b in collision_pairs(model)]
        nearest = min(nearest, *gaps)
    assert nearest > 0.0


def _hands_through_the_body() -> Motion:
    """Elbows bent by 2 rad and upper arms turned inward, so that both hands of the human end behind the breastbone."""
    t = np.arange(61) / 30
    bend = 1 - np.cos(np.pi * t)
    turns = {}
    for side, out in (("left", 1.0), ("right", -1.0)):
        turns[f"{side}_elbow"] = motions.axis_angle_to_quat(motions.UP, -out * bend)
        turns[f"{side}_shoulder"] = motions.axis_angle_to_quat(motions.UP, -out * 0.4 * bend)
    return motions.motion(2.0, 30, turns, "hands through the body")


def test_the_two_servo_head_of_the_manual_turns_as_the_human_s_does(tmp_path: Path) -> None:
    folder = tmp_path / "head"
    folder.mkdir()
    manual = (Path(__file__).parent.parent / "docs" / "rigs.md").read_text()
    (folder / "rig.toml").write_text(manual.split("```toml\n")[1].split("```")[0])
    (folder / "model.xml").write_text(
        """<mujoco><worldbody><body name="base"><freejoint/><geom size="0.1" contype="0" conaffinity="0"/>
        <body name="neck" pos="0 0 0.1"><joint name="pan" axis="0 0 1"/><geom size="0.05" contype="0" conaffinity="0"/>
        <body name="face"><joint name="tilt" axis="0 -1 0"/><geom size="0.04" contype="0" conaffinity="0"/>
        </body></body></body></worldbody></mujoco>"""
    )
    t = np.arange(91) / 30
    yaw, up = 0.8 * np.sin(1.5 * t), 0.3 * np.sin(2 * t)
    turn = quat_mul(motions.axis_angle_to_quat(motions.UP, yaw), motions.axis_angle_to_quat(motions.LEFT, -up))
    clip = motions.motion(3.0, 30, {"head": turn}, "look about")
    trajectory = retarget(clip, load_rig(folder))
    for second in (0.5, 1.0, 1.5, 2.0):
        wanted = [0.8 * np.sin(1.5 * second), 0.3 * np.sin(2 * second)]
        assert trajectory.joint_pos[shown_at(clip, trajectory, second)] == pytest.approx(wanted, abs=0.02)
    with pytest.raises(RigError, match=r"'head': without feet .* only be mounted on a stand"):
        retarget(clip, load_rig(folder), mount="free")


def test_one_frame_another_rate_and_bad_requests() -> None:
    rig = load_rig("puppet")
    clip = motions.stand(0.0)
    assert len(clip) == 1
    trajectory = retarget(clip, rig, fps=30)
    assert trajectory.fps == 30
    assert trajectory.duration >= 1.0
    with pytest.raises(ValueError, match="unknown mount 'shelf'; known are free, stand, hung"):
        retarget(clip, rig, mount="shelf")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="fps must be above 0, not 0"):
        retarget(clip, rig, fps=0)
