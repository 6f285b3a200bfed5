"""What a recording shows: who streamed, the poses as a viewer would have seen them, and the trajectory they make."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from drivers.endpoint import StreamError
from drivers.frame import Frame, FrameError, State
from drivers.gate import NS, Gate
from drivers.messages import Hello, unpack
from drivers.recording import Channel, Record
from motiongen.motion import Label, Source
from retarget.resample import interpolate
from retarget.rig import Rig
from retarget.trajectory import Trajectory

MOST_SAMPLES = 4 * 3600 * 1000  # Four hours at 1 kHz.


def hello_in(records: Iterable[Record]) -> Hello:
    """The first hello that can be read. Raises StreamError where there is none."""
    for record in records:
        if record.channel == Channel.HELLO:
            try:
                return unpack(record.data, Hello)
            except FrameError:
                continue
    raise StreamError("the recording holds no hello, so nobody knows which rig was streamed")


def frames_in(records: Iterable[Record], rig: Rig) -> Iterator[tuple[int, Frame]]:
    """The frames that a viewer of `rig` would have followed, each with our time at which its first sample was due, ns.

    Raises StreamError where there are frames, but none for `rig`.
    """
    gate = Gate(rig.hash, preview=True)
    for record in records:
        if record.channel == Channel.FRAMES:
            frame = gate.check(record.data, record.time_ns)
            if frame is not None:
                yield record.time_ns + frame.due_ns - gate.sender_ns(record.time_ns), frame
    if not gate.accepted:
        why = f": {gate.last_error}" if gate.last_error else ""
        raise StreamError(f"the recording holds no frame for rig {rig.name!r}{why}")


def trajectory_in(records: Iterable[Record], rig: Rig) -> Trajectory:
    """What was played, at the rate that the hello names: linear between samples, where some were lost too.

    Raises StreamError where there is no hello or no played frame for `rig`.
    """
    records = list(records)
    hello = hello_in(records)
    times, rows = _samples(frames_in(records, rig))
    seconds = (times[-1] - times[0]) / NS
    count = math.floor(seconds * hello.rate_hz + 0.5) + 1
    if count > MOST_SAMPLES:
        raise StreamError(f"the recording is {seconds:.0f} s long; {MOST_SAMPLES} samples are read at most")
    qpos = interpolate((times - times[0]) / NS, rows, np.arange(count) / hello.rate_hz)
    labels = (Label(0.0, seconds, hello.text),) if hello.text and seconds else ()
    return Trajectory(
        qpos,
        hello.rate_hz,
        rig.name,
        rig.joint_names(),
        labels=labels,
        source=Source(hello.source or "recording", licence=hello.licence),
    )


def _samples(frames: Iterable[tuple[int, Frame]]) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) ns that go up and rows (n, 7 + nj) as of `Trajectory.qpos`; a new frame replaces what was to come."""
    times: list[int] = []
    rows: list[np.ndarray] = []
    for due, frame in frames:
        if frame.state != State.PLAY:
            continue
        while times and times[-1] >= due:
            times.pop()
            rows.pop()
        times += [due + k * frame.period_ns for k in range(len(frame.pos))]
        rows += list(np.concatenate([frame.root, frame.pos], axis=1).astype(float))
    if not times:
        raise StreamError("the recording holds no frame that says play")
    return np.array(times), np.array(rows)
