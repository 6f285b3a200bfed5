"""A recording on the wire again: the same messages at the same distances in time, as a new stream."""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from dataclasses import dataclass, replace

from drivers.clock import MonotonicClock, Ticker
from drivers.frame import FrameError, decode
from drivers.messages import Stop, unpack
from drivers.publisher import Publisher
from drivers.recording import Channel, Record

TICK_NS = 500_000_000


@dataclass(frozen=True)
class Replayed:
    """What `replay` sent, how many messages it left out since they were damaged when they were recorded, and who or
    which rig ended it before its time, and why; "" where none did.
    """

    frames: int
    stops: int
    left_out: int
    heard: bool
    ended: str = ""


def replay(
    records: Iterable[Record], publisher: Publisher, wait_s: float = 0.0, clock: Ticker | None = None
) -> Replayed:
    """Send `records` through `publisher`, the first one now and the others as long after it as they were recorded.

    Frames get the present time and, for each stream that was recorded, the number of a new one; their sequence numbers
    and gaps stay. A stop stops. Waits up to `wait_s` for a first receiver.
    """
    clock = clock or MonotonicClock()
    heard = publisher.wait_for_subscriber(wait_s)
    streams: dict[int, int] = {}
    began = first = None
    frames = stops = left_out = 0
    ended = ""
    for record in records:
        if began is None or first is None:
            began, first = clock.now_ns(), record.time_ns
        when = began + record.time_ns - first
        while (now := clock.now_ns()) < when:
            clock.sleep_until_ns(min(when, now + TICK_NS))
            publisher.tick()
        try:
            if record.channel == Channel.FRAMES:
                frame = decode(record.data)
                stream = streams.setdefault(frame.stream, secrets.randbits(32))
                due = when + frame.due_ns - frame.capture_ns
                publisher.send(replace(frame, stream=stream, capture_ns=when, due_ns=due))
                frames += 1
            elif record.channel == Channel.STOP:
                publisher.stop(unpack(record.data, Stop).reason)
                stops += 1
        except FrameError:
            left_out += 1
        publisher.states()
        if not stops and (ended := publisher.ended()):
            break
    return Replayed(frames, stops, left_out, publisher.wait_for_subscriber(0) or heard, ended)
