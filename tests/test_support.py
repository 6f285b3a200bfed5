"""Support polygons against SciPy's hulls and hand-made ones; the residual wrench against non-negative least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from two_arm_rig import GRAVITY, HALF_FOOT, HEIGHT, WEIGHT
from two_arm_rig import two_arm_motion as motion
from two_arm_rig import two_arm_rig as make_rig

from retarget.rig import Foot, load_rig
from sim.balance import balance
from sim.dynamics import dynamics
from sim.scene import build_scene
from sim.support import EDGES, Support, convex_hull, find_soles, margin, residual_wrench, support

FORWARD = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
SQUARE = np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]])


def ground(points: np.ndarray, frames: int = 1) -> Support:
    return Support(np.tile(points, (frames, 1, 1)), np.ones((frames, len(points)), bool))


@pytest.mark.parametrize(
    ("at", "expected"),
    [((1, 0.5), 0.5), ((0.2, 0.5), 0.2), ((3, 0.5), -1), ((-3, -4), -5), ((2, 1), 0), ((1, 1.5), -0.5)],
)
def test_margin_of_a_rectangle(at, expected):
    assert margin(np.array([at], float), ground(SQUARE))[0] == pytest.approx(expected)
    inner = np.vstack([SQUARE[::-1], [[1, 0.4]]])  # neither order nor a point within changes it
    assert margin(np.array([at], float), ground(inner))[0] == pytest.approx(expected)


def test_margin_of_less_than_a_polygon():
    line, point, air = SQUARE[:2], SQUARE[:1], np.empty((0, 2))
    assert margin(np.array([[1.0, 0.3]]), ground(line))[0] == pytest.approx(-0.3)
    assert margin(np.array([[3.0, 0.0]]), ground(line))[0] == pytest.approx(-1)
    assert margin(np.array([[3.0, 4.0]]), ground(point))[0] == pytest.approx(-5)
    assert margin(np.array([[3.0, 4.0]]), ground(np.tile(point, (3, 1))))[0] == pytest.approx(-5)
    assert np.isnan(margin(np.array([[3.0, 4.0]]), ground(air))[0])
    assert np.isnan(margin(np.array([[np.nan, 4.0]]), ground(SQUARE))[0])


def test_hull_and_margin_agree_with_scipy():
    from scipy.spatial import ConvexHull

    draw = np.random.default_rng(3)
    for count in (3, 4, 8, 16):
        points = draw.normal(size=(count, 2))
        hull = ConvexHull(points)
        mine = convex_hull(points)
        start = int(np.argmin(np.linalg.norm(points[hull.vertices] - mine[0], axis=1)))
        np.testing.assert_allclose(mine, points[np.roll(hull.vertices, -start)])
        inside = points.mean(0)
        edge = -np.max(hull.equations[:, :2] @ inside + hull.equations[:, 2])
        assert margin(inside[None], ground(points))[0] == pytest.approx(edge)


def test_soles_are_where_the_model_has_them(tmp_path):
    corners = HALF_FOOT * np.array([[-1.0, -1], [-1, 1], [1, -1], [1, 1]])
    sole = find_soles(build_scene(make_rig(tmp_path), "free", motion().qpos[0]))["foot"]
    np.testing.assert_allclose(sole[np.lexsort(sole[:, 1::-1].T)], np.c_[corners, np.full(4, -HEIGHT)], atol=1e-9)
    for name in ("puppet", "humanoid"):
        rig = load_rig(name)
        row = np.array([0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)])
        for foot in find_soles(build_scene(rig, "free", row)).values():
            assert len(foot) == 4
            assert np.ptp(foot[:, 2]) < 1e-6


def test_a_foot_that_cannot_touch_is_refused(tmp_path):
    rig = make_rig(tmp_path)
    rig = replace(rig, feet=(Foot("hand", "left_arm", ("heel", "toe"), "left_ankle"),))
    with pytest.raises(ValueError, match="no part of 'left_arm' meets the floor in the nominal pose"):
        find_soles(build_scene(rig, "free", motion().qpos[0]))


def test_which_points_carry(tmp_path):
    scene = build_scene(make_rig(tmp_path), "free", motion().qpos[0])

    def carried(root, told):
        moves = motion(root=root)
        contacts = {"foot": np.full(len(moves), told)} if told is not None else {}
        return support(scene, dynamics(scene, moves.qpos, moves.fps), contacts).on.sum(1)

    def raised(t):
        return 0.006 * UP * np.ones((len(t), 1))

    assert (carried(lambda t: np.zeros((len(t), 3)), None) == 4).all()
    assert (carried(raised, None) == 0).all()
    assert (carried(raised, False) == 0).all()
    assert (carried(raised, True) == 4).all()
    assert (carried(lambda t: t[:, None] * FORWARD, None) == 4).all()  # it slides, but it carries


def test_a_lifted_heel_does_not_carry():
    rig = load_rig("humanoid")
    row = np.array([0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)])
    row[7 + rig.joint_names().index("left_ankle_pitch")] -= 0.1  # toes down: 6 mm above and below the joint's height
    scene = build_scene(rig, "free", row)
    ground = support(scene, dynamics(scene, row[None], 50), {})
    toes = find_soles(scene)["left_foot"][:, 0] > 0
    np.testing.assert_array_equal(ground.on[0], [*toes, True, True, True, True])


def test_a_motion_that_stands_needs_no_help(tmp_path):
    still = motion()
    found = balance(build_scene(make_rig(tmp_path), "free", still.qpos[0]), still)
    np.testing.assert_allclose(found.residual, 0, atol=1e-6 * WEIGHT)
    np.testing.assert_allclose(found.zmp_margin, HALF_FOOT - found.moves.com[0, 0])


def test_what_the_ground_cannot_pull_must_come_from_above(tmp_path):
    drop = motion(root=lambda t: -0.5 * 1.5 * GRAVITY * t[:, None] ** 2 * UP, seconds=0.4)
    found = balance(build_scene(make_rig(tmp_path), "free", drop.qpos[0]), drop)
    np.testing.assert_allclose(found.residual[3:-3, :3], np.tile([0, 0, -0.5 * WEIGHT], (15, 1)), atol=1e-6 * WEIGHT)


def test_in_flight_all_of_it_is_left_over(tmp_path):
    hover = motion(root=lambda t: 0.5 * UP * np.ones((len(t), 1)))
    hover = replace(hover, contacts={})
    found = balance(build_scene(make_rig(tmp_path), "free", hover.qpos[0]), hover)
    np.testing.assert_allclose(found.residual[:, :3], np.tile([0, 0, WEIGHT], (len(hover), 1)), atol=1e-6 * WEIGHT)
    assert np.isnan(found.com_margin).all()


def test_the_residual_is_that_of_non_negative_least_squares(tmp_path):
    from scipy.optimize import nnls

    wild = motion(root=lambda t: np.stack([0.1 * np.sin(9 * t), 0.1 * np.cos(7 * t), 0.1 * np.sin(12 * t)], axis=1))
    scene = build_scene(make_rig(tmp_path), "free", wild.qpos[0])
    moves = dynamics(scene, wild.qpos, wild.fps)
    stands = support(scene, moves, wild.contacts)
    found = residual_wrench(scene, moves, stands)
    assert np.linalg.norm(found, axis=1).max() > 0.1 * WEIGHT
    friction = 1.0  # of the rig's sole, which is more than the floor's 0.8
    angles = 2 * np.pi * np.arange(EDGES) / EDGES
    for k in range(0, len(wild), 5):
        needed = np.r_[moves.force[k], (moves.moment[k] - np.cross(moves.com[k], moves.force[k])) / HEIGHT]
        columns = []
        for x, y in stands.points[k]:
            for angle in angles:
                push = np.array([friction * np.cos(angle), friction * np.sin(angle), 1])
                columns.append(np.r_[push, np.cross([x, y, 0] - moves.com[k], push) / HEIGHT])
        least = nnls(np.array(columns).T, needed)[1]
        scaled = found[k] / np.repeat([1, HEIGHT], 3)
        assert np.linalg.norm(scaled) == pytest.approx(least, abs=1e-6 * WEIGHT)
