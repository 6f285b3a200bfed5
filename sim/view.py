"""Live views: a MuJoCo window or a browser page that shows the newest pose, wherever it comes from."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from retarget.rig import Mount, Rig
from sim.look import FIELD_OF_VIEW, Stage, aim, build_stage
from sim.window import opened_window

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]
Pose = tuple[Array, Array, Array]  # root position (3,) m, root quaternion (4,) w x y z, joints (nj,) rad
Poses = Callable[[], Pose | None]  # the newest pose, or None while there is none

PERIOD = 1 / 60  # s between two looks at the source


def view_native(rig: Rig, poses: Poses, *, mount: Mount | None = None, stop: threading.Event | None = None) -> None:
    """Show the newest pose in a MuJoCo window until it is closed or `stop` is set.

    Raises RuntimeError, in one line that names the other ways, where no window can be opened.
    """
    stage, start = build_stage(rig, mount), _nominal(rig, mount)
    data = mujoco.MjData(stage.model)
    with opened_window(stage, data, start[None]) as window:

        def show(row: Array) -> None:
            with window.lock():
                stage.place(data, row)
                window.cam.lookat[:2] = row[:2]
            window.sync()

        _follow(poses, show, lambda: window.is_running() and not (stop and stop.is_set()))


def view_web(
    rig: Rig, poses: Poses, *, port: int = 8080, mount: Mount | None = None, stop: threading.Event | None = None
) -> None:
    """Show the newest pose in a browser page on this machine alone, until `stop` is set or Ctrl-C.

    Prints the address on stderr, which ends in a token: without it there is no page. Raises RuntimeError where the port
    is taken.
    """
    from sim.guarded import guarded_server

    with guarded_server(port, f"rigcast: {rig.name}") as (server, address):
        print(f"open {address} in a browser; Ctrl-C ends", file=sys.stderr, flush=True)
        show = drawn_on(server, rig, mount)
        _follow(poses, show, lambda: not (stop and stop.is_set()))


def drawn_on(server: viser.ViserServer, rig: Rig, mount: Mount | None = None) -> Callable[[Array], None]:
    """Build the rig on the page of `server`, in its nominal pose; gives what shows it in another (7 + nj,)."""
    from mjviser import ViserMujocoScene

    stage, start = build_stage(rig, mount), _nominal(rig, mount)
    data = mujoco.MjData(stage.model)
    scene = ViserMujocoScene(server, stage.model, num_envs=1)
    server.initial_camera.position, server.initial_camera.look_at = _web_camera(start, stage)
    server.initial_camera.fov = float(np.radians(FIELD_OF_VIEW))

    def show(row: Array) -> None:
        stage.place(data, row)
        scene.update_from_mjdata(data)

    show(start)
    return show


def _follow(poses: Poses, show: Callable[[Array], None], running: Callable[[], bool]) -> None:
    """Look at `poses` every PERIOD and `show` what is new as one row (7 + nj,)."""
    last: Pose | None = None
    while running():
        pose = poses()
        if pose is not None and pose is not last:
            last = pose
            show(np.concatenate(pose))
        time.sleep(PERIOD)


def _nominal(rig: Rig, mount: Mount | None) -> Array:
    """The row (7 + nj,) of the rig in its nominal pose."""
    lift = rig.stand_clearance if (rig.mount if mount is None else mount) == "stand" else 0.0
    return np.array([0, 0, rig.nominal.height + lift, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)], float)


def _web_camera(row: Array, stage: Stage) -> tuple[Array, Array]:
    """Where a new page looks from and at (3,), (3,) in metres; the page keeps the root at its origin."""
    camera = mujoco.MjvCamera()
    aim(camera, row[None], stage)
    turn, down = np.radians([camera.azimuth, camera.elevation])
    ahead = np.array([np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn), np.sin(down)])
    target = camera.lookat - row[:3]
    return target - camera.distance * ahead, target
