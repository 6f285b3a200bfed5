"""`rigcast say --live`: a live service at whose machine somebody types, and each line takes effect at once."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Iterable
from itertools import chain

from drivers.control import Told
from drivers.signals import caught_signals
from motiongen.generator import check_prompt
from rigcast.delivery import Delivery
from rigcast.live import Stage, opened
from rigcast.service.line import FPS
from rigcast.service.live_service import REST
from rigcast.service.running import run

WORTH_TELLING = ("refused", "rejected")


def prompt(stage: Stage, delivery: Delivery, text: str | None) -> int:
    """Stream what is typed on stdin, beginning with `text`, until all is done or Ctrl-C; exit code 0.

    Raises ValueError for deliveries that end, PromptError for a text that nobody could follow, and as `opened` does.
    """
    if delivery.out or delivery.view != "none" or delivery.rate is not None or delivery.unchecked or delivery.json:
        raise ValueError(
            "--live streams at 50 Hz what has passed, and nothing else: --publish and --insecure go with it"
        )
    lines = [] if text is None else [check_prompt(text)]
    with caught_signals() as caught, opened(stage, lambda: bool(caught), _tell) as live:
        if live is None:
            return 0
        print(
            f"{stage.rig.name} idles on {stage.endpoint}; say what it shall do, or {REST}", file=sys.stderr, flush=True
        )
        ended = threading.Event()
        threading.Thread(target=listen, args=(chain(lines, sys.stdin), live.service.typed, ended), daemon=True).start()
        service = live.service
        run(service, lambda: len(caught) + (ended.is_set() and not service.busy), lambda: None, live.clock)
    sent, work = service.counts["frames"], live.line.work
    took = ", ".join(f"{name} {seconds / (live.line.frame / FPS):.2f}" for name, seconds in work.seconds.items())
    print(f"{sent} frames; {work.refused} blocks refused; seconds of work a second of motion: {took}")
    return 0


def listen(lines: Iterable[str], typed: queue.SimpleQueue[str], ended: threading.Event) -> None:
    """Put `lines` into `typed` as they come, and set `ended` after the last one."""
    for line in lines:
        if line.strip():
            typed.put(line.strip())
    ended.set()


def _tell(said: Told) -> None:
    """What somebody who types has to know: that nothing comes of a line, and why."""
    if said.event in WORTH_TELLING or not said.id:
        print(said.detail, file=sys.stderr, flush=True)
