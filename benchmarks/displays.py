"""A screen that is not there, and what is on it."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from PIL import ImageGrab

PATIENCE = 20.0  # s; software drawing takes a while


@contextmanager
def virtual_display(size: str = "640x480") -> Iterator[str]:
    """A virtual X display, by its name. Raises FileNotFoundError where there is no Xvfb."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{size}x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL) as server:
        os.close(write)
        try:
            with os.fdopen(read) as pipe:
                name = ":" + pipe.readline().strip()
            yield name
        finally:
            server.terminate()


def grab(display: str, *, until: Callable[[np.ndarray], bool]) -> np.ndarray:
    """The screen (height, width, 3), once something is drawn and `until` holds, or when patience is over."""
    deadline = time.monotonic() + PATIENCE
    while True:
        picture = np.asarray(ImageGrab.grab(xdisplay=display)).astype(int)
        if (picture.std() > 15 and until(picture)) or time.monotonic() > deadline:
            return picture
        time.sleep(0.1)
