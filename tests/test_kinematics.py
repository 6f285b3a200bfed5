"""Forward kinematics, Jacobians and steps of a whole trajectory against MuJoCo's own, frame by frame."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numba
import numpy as np
import pytest
from two_arm_rig import two_arm_rig
from wandering import RIGS, nominal, wandering

from retarget import loops, sparse
from retarget.__main__ import main as warm_up
from retarget.kinematics import meetings, on_body, poses, tree_of, velocities
from retarget.loops import along, differences, moved
from retarget.model import load_model
from retarget.rig import load_rig

ODD = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 1"><freejoint/><geom size="0.1"/>
<body pos="0.1 0.2 -0.3" quat="0.5 0.1 -0.7 0.4"><geom size="0.1"/>
<joint name="a" axis="1 2 3" pos="0.05 -0.02 0.01" ref="0.7"/><joint name="b" axis="-1 0.2 0" pos="-0.03 0 0.08"/>
<body pos="0.2 0 0" euler="10 20 30"><geom size="0.1"/>
<body pos="0 0 0.3"><geom size="0.1"/><joint name="c" axis="0 1 0" pos="0 0.1 0"/></body>
</body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("name", [*RIGS, "odd"])
def test_bodies_are_where_mujoco_has_them(name: str) -> None:
    """The odd one has joints beside their bodies' origins, two on one body, one not at 0 and a body without any."""
    model = mujoco.MjModel.from_xml_string(ODD) if name == "odd" else load_model(load_rig(name))
    qpos = np.random.default_rng(1).normal(size=(4, model.nq))
    at, data = poses(tree_of(model), qpos), mujoco.MjData(model)
    for frame, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for found, wanted in ((at.place, data.xpos), (at.turn, data.xquat), (at.matrix, data.xmat.reshape(-1, 3, 3))):
            assert found[frame] == pytest.approx(wanted, abs=1e-12)
        assert at.axis[frame, 6:] == pytest.approx(data.xaxis[1:], abs=1e-12)
        assert at.anchor[frame, 6:] == pytest.approx(data.xanchor[1:], abs=1e-12)


def test_loops_are_compiled_where_no_folder_can_be_written_to(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_folder(*, cache: bool = False, **options: bool) -> object:
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return numba.njit(**options)

    monkeypatch.setattr(loops, "njit", without_folder)
    assert loops.compiled(lambda x: x + 1)(2) == 3


@pytest.mark.parametrize("name", RIGS)
def test_jacobians_are_mujoco_s(name: str) -> None:
    rig = load_rig(name)
    model = load_model(rig)
    tree, qpos = tree_of(model), wandering(rig, 0.1, 1)
    bodies = np.arange(1, model.nbody)
    spots = np.random.default_rng(2).normal(size=(len(bodies), 3))
    at = poses(tree, qpos)
    points = on_body(at, bodies, spots)
    data, wanted = mujoco.MjData(model), np.empty((3, model.nv))
    for frame, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for i, body in enumerate(bodies):
            mujoco.mj_jac(model, data, wanted, None, points[frame, i], body)
            found = velocities(at, np.arange(model.nv), points[:, i, None])[frame] * tree.carries[body][:, None]
            assert np.abs(found.T - wanted).max() < 1e-10


def test_velocities_along_a_direction_are_those_of_the_jacobian() -> None:
    rig = load_rig("puppet")
    tree, qpos = tree_of(load_model(rig)), wandering(rig, 0.1, 1)
    at, every = poses(tree, qpos), np.arange(tree.model.nv)
    frame, (point, way) = np.array([0, 3, 3]), np.random.default_rng(11).normal(size=(2, 3, 3))
    wanted = np.einsum("nvi,ni->nv", velocities(at, every, point[:, None], frame), way)
    carried = np.tile([1.0, -1.0], (3, tree.model.nv // 2))
    assert along(at.axis, at.anchor, frame, point, way, carried) == pytest.approx(wanted * carried, abs=1e-12)


def test_bodies_that_meet_are_as_far_apart_a_little_later_as_mujoco_says(tmp_path: Path) -> None:
    """The right arm swings on towards the left one, by 0.02 rad; they are balls and capsules."""
    rig = two_arm_rig(tmp_path)
    model = load_model(rig)
    model.geom_margin[:] = 0.2
    tree, qpos = tree_of(model), np.tile(nominal(rig), (2, 1))
    qpos[:, 8] = 0.45, 0.47
    at = poses(tree, qpos)
    before, wanted = meetings(model, qpos, np.array([0])), meetings(model, qpos, np.array([1]))
    met = before.carried(at, at, 1)
    assert len(wanted.apart) == len(met.apart) > 0
    assert list(met.frame) == list(wanted.frame) == [1] * len(met.apart)
    assert met.apart == pytest.approx(wanted.apart, abs=2e-4)
    assert np.abs(before.apart - wanted.apart).max() > 1e-3
    assert met.place == pytest.approx(wanted.place, abs=0.01)
    both = meetings(model, qpos)
    assert both.apart == pytest.approx(before.and_those(wanted).apart)
    assert both.of(both.frame == 1).apart == pytest.approx(wanted.apart)


def test_steps_are_mujoco_s() -> None:
    model = load_model(load_rig("puppet"))
    qpos = wandering(load_rig("puppet"), 0.2, 3)
    step = np.random.default_rng(4).normal(size=(len(qpos), model.nv))
    for q, v, found in zip(qpos, step, moved(qpos, step), strict=True):
        wanted = q.copy()
        mujoco.mj_integratePos(model, wanted, v, 1.0)
        assert found == pytest.approx(wanted, abs=1e-12)
        mujoco.mj_differentiatePos(model, v, 1.0, q, found)
        assert differences(np.stack([q, found]))[0] == pytest.approx(v, abs=1e-12)


def test_what_install_compiles_is_all_that_clips_need(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "kept", lambda: False)
    warm_up()
    late = [
        name
        for name, loop in (vars(loops) | vars(sparse)).items()
        if name[0] != "_" and hasattr(loop, "signatures") and not loop.signatures
    ]
    assert late == []
