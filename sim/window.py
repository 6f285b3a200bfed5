"""A MuJoCo window, or one line that says why there is none and what else shows a motion."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.look import Stage, aim

CLOSING = 5.0  # s to wait for the window to go
OTHER_WAYS = "use --view web, or write a film with --out FILE.mp4 or .gif"


@contextmanager
def opened_window(
    stage: Stage,
    data: mujoco.MjData,
    rows: NDArray[np.float64],
    on_key: Callable[[int], None] | None = None,
) -> Iterator[Any]:
    """MuJoCo's passive viewer on `data`, aimed so that all of `rows` (T, 7 + nj) fit in; `on_key` is told GLFW's codes.

    Raises RuntimeError, in one line that names the other ways, where no window can be opened.
    """
    require_display()
    import mujoco.viewer

    stage.place(data, rows[0])
    others = set(threading.enumerate())
    try:
        window = mujoco.viewer.launch_passive(
            stage.model, data, key_callback=on_key, show_left_ui=False, show_right_ui=False
        )
    except RuntimeError as problem:  # macOS wants its own interpreter, mjpython
        raise RuntimeError(f"no MuJoCo window here ({problem}); {OTHER_WAYS}") from None
    drawing = set(threading.enumerate()) - others
    try:
        with window:
            aim(window.cam, rows, stage)
            yield window
    finally:  # closing only asks: a thread that still draws when Python exits makes both wait for ever in X11
        for thread in drawing:
            thread.join(CLOSING)


def require_display() -> None:
    """Raise RuntimeError, in one line that names the other ways, where there is no screen for a window.

    GLFW is asked, since MuJoCo's viewer waits for ever when its own thread fails to open a window.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RuntimeError(f"there is no display for a MuJoCo window; {OTHER_WAYS}")
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ready = glfw.init()
    if not ready:
        raise RuntimeError(f"the display {os.environ.get('DISPLAY', '')!r} cannot be opened; {OTHER_WAYS}")
