"""The same motion again and again, each time on a rig a little other than thought, and pushed: a rate of success."""

from __future__ import annotations

import copy
from collections import Counter

import mujoco
import numpy as np

from retarget.trajectory import Trajectory
from sim.evidence import Evidence
from sim.geometry import Geometry, measure
from sim.physical import PHYSICAL
from sim.report import Controller, Trials
from sim.scene import DAMPING, DRIVE, GAIN, Scene, build_scene
from sim.simulate import Push, run_many

# By how much a trial differs from the rig as it is written down: uniform, plus or minus a share.
MASS = 0.05  # of every part: what cables, screws and covers weigh
FRICTION = 0.25  # of floor and soles: 0.6 to 1.0, from dusty tiles to clean rubber
GAINS = 0.1  # of every servo: spread from unit to unit
SUPPLY = 0.05  # of the voltage: a battery from full to half empty
# One push a trial, at any time and from any side: it changes the rig's speed by 0.1 m/s.
PUSH = 0.1  # weights
PUSH_TIME = 0.1  # s


def run_trials(
    trajectory: Trajectory,
    scene: Scene,
    asked: Geometry,
    count: int,
    *,
    first: int = 0,
    seed: int = 0,
    threads: int = 1,
    controller: Controller = "open_loop",
) -> Trials:
    """How many of `count` trials, from number `first` on, pass every check on what physics made of `trajectory`.

    `scene` is the rig as it is written down, and `asked` the geometry of the trajectory on it. In a trial the gears
    have play, and what `variant` and `any_push` change is drawn from `seed`; trial i is the same whatever `count` and
    `threads` are. Raises ValueError for less than one trial or thread.
    """
    if count < 1 or threads < 1:
        raise ValueError(f"trials: {count} trials in {threads} threads; there should be at least 1 of both")
    loose = build_scene(scene.rig, scene.mount, trajectory.qpos[0], play=True)
    draws = [np.random.default_rng([seed, i]) for i in range(first, first + count)]
    models = [variant(loose, draw) for draw in draws]
    pushes = [any_push(loose, trajectory.duration, draw) for draw in draws]
    failures: Counter[str] = Counter()
    passed = 0
    for rollout in run_many(loose, models, trajectory, pushes, threads, controller):
        evidence = Evidence(trajectory, scene, rollout, asked, measure(scene, rollout.qpos), None)
        failed = [c.name for c in (check(evidence) for check in PHYSICAL) if not c.ok]
        failures.update(failed)
        passed += not failed
    return Trials(count, passed, seed, tuple(failures.most_common()))


def variant(scene: Scene, draw: np.random.Generator) -> mujoco.MjModel:
    """The scene's model with other masses, friction, gains and supply."""
    model, servos = copy.copy(scene.model), len(scene.rig.joints)
    weight = 1 + draw.uniform(-MASS, MASS, model.nbody)
    model.body_mass *= weight
    model.body_inertia *= weight[:, None]
    model.geom_friction[:, 0] *= 1 + draw.uniform(-FRICTION, FRICTION)
    model.actuator_gainprm[:servos, (GAIN, DAMPING)] *= 1 + draw.uniform(-GAINS, GAINS, (servos, 1))
    supply = 1 + draw.uniform(-SUPPLY, SUPPLY)
    model.actuator_gainprm[:servos, DRIVE] *= supply
    model.actuator_forcerange[:servos] *= supply
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def any_push(scene: Scene, seconds: float, draw: np.random.Generator) -> Push | None:
    """A push along the floor within `seconds`; none on a stand, whose post takes it."""
    start, angle = draw.uniform(0, max(seconds, PUSH_TIME)), draw.uniform(0, 2 * np.pi)
    if scene.mount == "stand":
        return None
    force = PUSH * scene.weight
    return Push(start, PUSH_TIME, (force * float(np.cos(angle)), force * float(np.sin(angle)), 0.0))
