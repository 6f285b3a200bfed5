"""A screen that is not there, and what is on it."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import ImageGrab


@contextmanager
def virtual_display(size: str = "640x480") -> Iterator[str]:
    """A virtual X display, by its name; skips where there is no Xvfb."""
    if shutil.which("Xvfb") is None:
        pytest.skip("needs Xvfb")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{size}x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL) as server:
        os.close(write)
        with os.fdopen(read) as pipe:
            name = ":" + pipe.readline().strip()
        yield name
        server.terminate()


def grab(display: str, *, until: Callable[[np.ndarray], bool]) -> np.ndarray:
    """The screen (height, width, 3), once something is drawn and `until` holds; software drawing takes a while."""
    deadline = time.monotonic() + 20
    while True:
        picture = np.asarray(ImageGrab.grab(xdisplay=display)).astype(int)
        if (picture.std() > 15 and until(picture)) or time.monotonic() > deadline:
            return picture
        time.sleep(0.1)
