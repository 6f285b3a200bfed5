"""Live views: a MuJoCo window or a browser page that shows the newest pose, wherever it comes from."""

from __future__ import annotations

import os
import sys
import threading
import time
import warnings
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from retarget.rig import Mount, Rig
from sim.look import FIELD_OF_VIEW, Stage, aim, build_stage

Array = NDArray[np.float64]
Pose = tuple[Array, Array, Array]  # root position (3,) m, root quaternion (4,) w x y z, joints (nj,) rad
Poses = Callable[[], Pose | None]  # the newest pose, or None while there is none

PERIOD = 1 / 60  # s between two looks at the source
CLOSING = 5.0  # s to wait for the window to go
OTHER_WAYS = "use --view web, or write a film with --out FILE.mp4"


def view_native(rig: Rig, poses: Poses, *, mount: Mount | None = None, stop: threading.Event | None = None) -> None:
    """Show the newest pose in a MuJoCo window until it is closed or `stop` is set.

    Raises RuntimeError, in one line that names the other ways, where no window can be opened.
    """
    _require_window()
    import mujoco.viewer

    stage = build_stage(rig, mount)
    data = mujoco.MjData(stage.model)
    start = _nominal(rig, mount)
    stage.place(data, start)
    others = set(threading.enumerate())
    try:
        window = mujoco.viewer.launch_passive(stage.model, data, show_left_ui=False, show_right_ui=False)
    except RuntimeError as problem:  # macOS wants its own interpreter, mjpython
        raise RuntimeError(f"no MuJoCo window here ({problem}); {OTHER_WAYS}") from None
    drawing = set(threading.enumerate()) - others
    try:
        with window:
            aim(window.cam, start[None], stage)

            def show(row: Array) -> None:
                with window.lock():
                    stage.place(data, row)
                    window.cam.lookat[:2] = row[:2]
                window.sync()

            _follow(poses, show, lambda: window.is_running() and not (stop and stop.is_set()))
    finally:  # closing only asks: a thread that still draws when Python exits makes both wait for ever in X11
        for thread in drawing:
            thread.join(CLOSING)


def view_web(
    rig: Rig, poses: Poses, *, port: int = 8080, mount: Mount | None = None, stop: threading.Event | None = None
) -> None:
    """Show the newest pose in a browser page on this machine alone, until `stop` is set or Ctrl-C.

    Prints the address on stderr, which ends in a token: without it there is no page. Raises RuntimeError where the port
    is taken.
    """
    from mjviser import ViserMujocoScene

    from sim.guarded import guarded_server

    with guarded_server(port, f"rigcast: {rig.name}") as (server, address):
        print(f"open {address} in a browser; Ctrl-C ends", file=sys.stderr, flush=True)
        stage, start = build_stage(rig, mount), _nominal(rig, mount)
        data = mujoco.MjData(stage.model)
        scene = ViserMujocoScene(server, stage.model, num_envs=1)
        server.initial_camera.position, server.initial_camera.look_at = _web_camera(start, stage)
        server.initial_camera.fov = float(np.radians(FIELD_OF_VIEW))

        def show(row: Array) -> None:
            stage.place(data, row)
            scene.update_from_mjdata(data)

        show(start)
        _follow(poses, show, lambda: not (stop and stop.is_set()))


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


def _require_window() -> None:
    """GLFW is asked first, since MuJoCo's viewer waits for ever when its own thread fails to open a window."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RuntimeError(f"there is no display for a MuJoCo window; {OTHER_WAYS}")
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ready = glfw.init()
    if not ready:
        raise RuntimeError(f"the display {os.environ.get('DISPLAY', '')!r} cannot be opened; {OTHER_WAYS}")


def _web_camera(row: Array, stage: Stage) -> tuple[Array, Array]:
    """Where a new page looks from and at (3,), (3,) in metres; the page keeps the root at its origin."""
    camera = mujoco.MjvCamera()
    aim(camera, row[None], stage)
    turn, down = np.radians([camera.azimuth, camera.elevation])
    ahead = np.array([np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn), np.sin(down)])
    target = camera.lookat - row[:3]
    return target - camera.distance * ahead, target
