"""The body that an emulated bus turns, on the screen or on film."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Literal

import numpy as np

from drivers.emulation.line import EmulatedLine
from retarget.rig import Mount, Rig
from rigcast import show
from rigcast.driving import FILM_HZ, FILM_SIZE
from sim.render import render_video
from sim.view import Pose, view_native, view_web


def show_body(
    emulator: EmulatedLine,
    rig: Rig,
    mount: Mount,
    view: Literal["native", "web", "none"],
    film: Path | None,
    caught: list[str],
) -> None:
    """Until a signal is `caught` or the window is closed: show where the body is, and film it while the torque is on.

    Raises RuntimeError where nothing can be shown, ValueError for a film of an unknown kind.
    """
    rows: list[np.ndarray] = []
    ended = threading.Event()
    camera = threading.Thread(target=_look, args=(emulator, rows, caught, ended))
    camera.start()
    try:
        if view == "native":
            view_native(rig, lambda: _pose(emulator), mount=mount, stop=ended)
        elif view == "web":
            view_web(rig, lambda: _pose(emulator), mount=mount, stop=ended)
        else:
            ended.wait()
    finally:
        ended.set()
        camera.join()
    if film is not None and not rows:
        show.warn("the torque never came on, so there is no film")
    elif film is not None:
        render_video(np.array(rows), FILM_HZ, rig, film, size=FILM_SIZE, mount=mount)
        print(f"wrote {film}", flush=True)


def _look(emulator: EmulatedLine, rows: list[np.ndarray], caught: list[str], ended: threading.Event) -> None:
    """A row a picture while any torque is on; sets `ended` when a signal came."""
    while not caught and not ended.wait(1 / FILM_HZ - time.monotonic() % (1 / FILM_HZ)):
        if any(emulator.torque().values()):
            rows.append(emulator.qpos())
    ended.set()


def _pose(emulator: EmulatedLine) -> Pose:
    row = emulator.qpos()
    return row[:3], row[3:7], row[7:]
