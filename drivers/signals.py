"""Ctrl-C, SIGTERM and a closed terminal as a flag: a control loop ends between two packets, never within one."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


@contextlib.contextmanager
def caught_signals() -> Iterator[list[str]]:
    """A list that the names of arriving signals are added to, while the context lasts.

    In a thread other than the main one, which cannot handle signals, it stays empty.
    """
    caught: list[str] = []
    if threading.current_thread() is not threading.main_thread():
        yield caught
        return

    def note(number: int, frame: FrameType | None) -> None:
        caught.append(signal.Signals(number).name)

    before = {s: signal.signal(s, note) for s in (getattr(signal, n) for n in NAMES if hasattr(signal, n))}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
