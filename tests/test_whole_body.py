"""The full-state controller against free fall, the pendulum of its divergent component, and MuJoCo's own steps."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from drivers.upright import missing
from retarget.rig import load_rig
from retarget.trajectory import Trajectory
from sim import fix
from sim.checks import judge
from sim.dynamics import rates
from sim.feedback import controllers, feedback_of
from sim.mending.tidy import Mended
from sim.scene import TIMESTEP, Scene, build_scene
from sim.simulate import Push, run
from sim.whole_body import PRESS, SPARE, WholeBody

RIG = load_rig("humanoid")
FPS = 50.0
PROMPT = replace(RIG, sensors=replace(RIG.sensors, delay=0.0))


def still(seconds: float = 2.0) -> Trajectory:
    """The humanoid stands with its knees bent a little."""
    pose = RIG.pose_vector(RIG.nominal)
    row = np.array([0, 0, RIG.nominal.height, 1, 0, 0, 0, *pose], float)
    count = round(seconds * FPS)
    return Trajectory(np.tile(row, (count, 1)), FPS, "humanoid", RIG.joint_names())


def scene_of(trajectory: Trajectory) -> Scene:
    return build_scene(RIG, "free", trajectory.qpos[0])


def ahead(rows: np.ndarray, scene: Scene) -> np.ndarray:
    """(T, 2) how far ξ = c + ċ / ω is from where it began."""
    data, com = mujoco.MjData(scene.model), []
    for row in rows:
        data.qpos[:] = row
        mujoco.mj_kinematics(scene.model, data)
        mujoco.mj_comPos(scene.model, data)
        com.append(data.subtree_com[1].copy())
    c = np.array(com)
    return (c - c[0] + np.gradient(c, 1 / FPS, axis=0) * np.sqrt(c[0, 2] / 9.81))[:, :2]


def quickens(scene: Scene, qpos: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """(3,) m/s² of the centre of mass, by a central difference of MuJoCo's own momentum."""
    data, speed = mujoco.MjData(scene.model), []
    for seconds in (-1e-5, 1e-5):
        data.qpos[:], data.qvel[:] = qpos, velocity + seconds * acceleration
        mujoco.mj_integratePos(scene.model, data.qpos, velocity + 0.5 * seconds * acceleration, seconds)
        speed.append(com_speed(scene, data))
    return (speed[1] - speed[0]) / 2e-5


def com_speed(scene: Scene, data: mujoco.MjData) -> np.ndarray:
    mujoco.mj_forward(scene.model, data)
    mujoco.mj_subtreeVel(scene.model, data)
    return data.subtree_linvel[1].copy()


def test_nothing_keeps_a_body_from_free_fall():
    """A metre above the floor no sole touches: whatever the joints do, the centre of mass falls by g."""
    asked = still(0.2)
    scene, rng = scene_of(asked), np.random.default_rng(0)
    qpos, velocity = asked.qpos[0].copy(), rng.normal(size=6 + len(RIG.joints))
    qpos[2] += 1.0
    acceleration, _ = WholeBody(scene, asked).answer(3, qpos, velocity)
    np.testing.assert_allclose(quickens(scene, qpos, velocity, acceleration), [0, 0, -9.81], atol=1e-3)


@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_what_is_off_fades_as_the_pendulum_says(way):
    """After a push ξ − ξ* = e^(−PRESS ω t), while the zero-moment point keeps within the soles."""
    asked = still()
    scene = scene_of(asked)
    force = 0.1 * scene.weight * np.array([*way, 0.0])
    rollout = run(scene, asked, Push(0.4, 0.1, tuple(force)), controller="full_state")
    off = ahead(rollout.qpos, scene) @ np.array(way)
    first, last = 27, 33
    assert off[first] > 0.01
    rate = np.log(off[first] / off[last]) / ((last - first) / FPS)
    assert rate == pytest.approx(PRESS * np.sqrt(9.81 / 0.95), rel=0.35)  # servos hold against it, too
    assert np.abs(off[-10:]).max() < 3e-3


def test_physics_does_what_was_meant():
    """On its feet and pushed: over a frame MuJoCo speeds the centre of mass up as the answer says it will."""
    asked = still(0.5)
    scene = scene_of(asked)
    model, data, torque = scene.model, mujoco.MjData(scene.model), []
    scene.place(data, asked.qpos[0])
    for step in range(350):
        data.ctrl[:] = asked.targets[0]
        data.qfrc_applied[:2] = (90.0, -60.0) if step > 300 else 0.0
        mujoco.mj_step(model, data)
    data.qfrc_applied[:] = 0
    body, now, before = WholeBody(scene, asked), (data.qpos.copy(), data.qvel.copy()), com_speed(scene, data)
    (meant, _), told = body.answer(5, *now), body.targets(5, *now)
    for _ in range(round(1 / FPS / TIMESTEP)):
        data.ctrl[:] = told
        mujoco.mj_step(model, data)
        torque.append(data.actuator_force[: len(RIG.joints)].copy())
    wanted = quickens(scene, *now, meant)
    assert np.linalg.norm(wanted) > 0.5
    np.testing.assert_allclose((com_speed(scene, data) - before) * FPS, wanted, atol=0.2 * np.linalg.norm(wanted))
    assert (np.abs(np.mean(torque, axis=0)) <= SPARE * np.array([j.torque for j in RIG.joints])).all()


def test_a_foot_in_the_air_goes_to_its_place_in_the_world():
    """3 cm to the left of where it should be, the lifted foot is pulled back by a spring of (20 rad/s)²."""
    asked = still(0.5)
    asked = replace(asked, contacts={"left_foot": np.zeros(25, bool), "right_foot": np.ones(25, bool)})
    scene = scene_of(asked)
    qpos, velocity = asked.qpos[0].copy(), np.zeros(6 + len(RIG.joints))
    qpos[1] += 0.03
    qpos[2] -= 0.001
    acceleration, _ = WholeBody(scene, asked).answer(3, qpos, velocity)
    data, foot = mujoco.MjData(scene.model), scene.model.body("left_foot").id
    jacobian = np.zeros((3, scene.model.nv))
    data.qpos[:] = qpos
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_comPos(scene.model, data)
    mujoco.mj_jacBody(scene.model, data, jacobian, None, foot)
    np.testing.assert_allclose(jacobian @ acceleration, [0, -0.03 * 400, 0.001 * 400], atol=1.0)


@pytest.mark.parametrize("rig", [PROMPT, RIG], ids=["at once", "20 ms late"])
def test_it_stands_where_nothing_else_does(rig):
    asked = still(2.5)
    scene = build_scene(rig, "free", asked.qpos[0])
    push = Push(0.3, 0.1, (0.7 * scene.weight, 0.0, 0.0))
    falls = {c: run(scene, asked, push, controller=c).qpos[-1, 2] < 0.8 for c in controllers(rig)}
    assert falls == {"open_loop": True, "imu": True, "full_state": False}


def test_what_is_late_is_what_physics_made_of_it_since():
    """On the rig as it is written down a state that is 20 ms old is as good as one of now."""
    asked = still(1.0)
    push = Push(0.0, 0.1, (40.0, 20.0, 0.0))
    ends = [run(build_scene(rig, "free", asked.qpos[0]), asked, push, controller="full_state") for rig in (PROMPT, RIG)]
    prompt, late = (rollout.qpos for rollout in ends)
    assert np.abs(prompt[15] - asked.qpos[0]).max() > 0.005
    np.testing.assert_allclose(late[-1], prompt[-1], atol=2e-3)


def test_only_a_rig_that_declares_it_has_it():
    puppet = load_rig("puppet")
    assert controllers(puppet) == ("open_loop", "imu")
    assert controllers(RIG) == ("open_loop", "imu", "full_state")
    row = np.array([0, 0, puppet.nominal.height, 1, 0, 0, 0, *puppet.pose_vector(puppet.nominal)], float)
    asked = Trajectory(np.tile(row, (30, 1)), FPS, "puppet", puppet.joint_names())
    with pytest.raises(ValueError, match=r"'puppet' does not know its full state \(sensors.full_state\)"):
        judge(asked, puppet, mount="free", controller="full_state")
    assert "'full_state'" in missing("full_state", None)


def test_the_least_controller_that_holds_is_taken(monkeypatch):
    """`judge_mended` asks in turn, and the report names the one that it passed with."""
    asked, tried = still(1.0), []

    def judged(trajectory, rig, *, controller="open_loop", **rest):
        tried.append(controller)
        report, rollout = judge(trajectory, rig, mount="free", controller=controller)
        return replace(report, ok=len(tried) > 1 and controller == "full_state"), rollout

    monkeypatch.setattr(fix, "judge", judged)
    monkeypatch.setattr(fix, "mend", lambda trajectory, rig: Mended(trajectory, ()))
    report = fix.judge_mended(asked, RIG, mount="free")[1]
    assert tried == ["open_loop", "open_loop", "imu", "full_state"]
    assert (report.ok, report.controller) == (True, "full_state")


def test_no_force_but_the_servos():
    """The very targets, stepped once more: a floor, motors, and nothing else on any body."""
    asked = still(1.0)
    scene = scene_of(asked)
    rollout = run(scene, asked, controller="full_state")
    again, feedback = mujoco.MjData(scene.model), feedback_of("full_state", scene, asked)
    assert feedback is not None
    assert (scene.model.neq, scene.model.nmocap, scene.model.ntendon) == (0, 0, 0)
    scene.place(again, asked.qpos[0])
    for frame in range(-25, len(asked)):
        state = np.concatenate([[again.time], again.qpos, again.qvel])[None]
        again.ctrl[:] = asked.targets[max(frame, 0)] + (feedback.added(frame, state)[0] if frame >= 0 else 0.0)
        mujoco.mj_step(scene.model, again, round(1 / FPS / TIMESTEP))
        assert not again.xfrc_applied.any()
        assert not again.qfrc_applied.any()
    np.testing.assert_allclose(again.qpos, rollout.qpos[-1], atol=1e-6)
    assert np.abs(rates(rollout.qpos, FPS)[0][-5:]).max() < 0.05
