"""Where the time went: seconds of each stage since the process began, and a word on stderr while one runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

BEGAN = time.monotonic()  # the entry point imports this module before anything else
_CLEAR_LINE = "\r\x1b[K"


class Times:
    """Seconds by stage, in the order in which the stages ended; "start" is from process start to this object."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {"start": time.monotonic() - BEGAN}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the block as stage `name`, and say so on stderr where that is a terminal."""
        shown = sys.stderr.isatty()
        if shown:
            print(f"{_CLEAR_LINE}{name} …", end="", file=sys.stderr, flush=True)
        began = time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.monotonic() - began
            if shown:
                print(_CLEAR_LINE, end="", file=sys.stderr, flush=True)
