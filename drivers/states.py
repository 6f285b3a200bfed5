"""What a drive commanded and measured, cycle by cycle, in a recording (`recording.py`).

The states lie where the hello does, as they do on the wire to those who watch; the first record says which rig it is.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from drivers.frame import UNCHECKED, FrameError
from drivers.messages import Hello, RigState, pack, unpack
from drivers.recorded import hello_in
from drivers.recording import Channel, Record, Recorder
from motiongen.files import replacing
from retarget.rig import Rig

COLUMNS = ("command", "position", "current", "temperature", "voltage")
UNITS = dict(zip(COLUMNS, ("rad", "rad", "A", "C", "V"), strict=True))


def recorder_of(recorder: Recorder, rig: Rig, rate_hz: float) -> Callable[[RigState], None]:
    """Writes each state of a drive of `rig`, `rate_hz` a second, to `recorder`. Raises OSError where it cannot."""
    driven = [j for s in rig.servos for j in rig.joints if j.name == s.joint]
    hello = Hello(
        rig=rig.name,
        rig_hash=rig.hash,
        joints=tuple(j.name for j in driven),
        lower=tuple(j.lower for j in driven),
        upper=tuple(j.upper for j in driven),
        velocity=tuple(j.velocity for j in driven),
        rate_hz=rate_hz,
        stream=0,
        report_id=UNCHECKED,
        source="rigcast drive",
    )
    started = False

    def write(state: RigState) -> None:
        nonlocal started
        if not started:
            recorder.write(Record(Channel.HELLO, state.time_ns, pack(hello)))
            started = True
        recorder.write(Record(Channel.HELLO, state.time_ns, pack(state)))

    return write


def states_in(records: Iterable[Record]) -> Iterator[RigState]:
    """The states in a recording, in order."""
    for record in records:
        if record.channel == Channel.HELLO:
            try:
                yield unpack(record.data, RigState)
            except FrameError:
                continue  # the hello


def write_table(records: Iterable[Record], path: Path) -> int:
    """Write the states as .csv, one row a cycle: seconds, mode, reason, then of each joint what was measured; the rows.

    Raises StreamError where no hello says which rig it is, OSError where the file cannot be written.
    """
    records = list(records)
    joints = hello_in(records).joints
    states = list(states_in(records))
    told = [name for name in COLUMNS if any(getattr(s, name) for s in states)]
    with replacing(path) as temporary, temporary.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time_s", "mode", "reason", *(f"{j}_{name}_{UNITS[name]}" for j in joints for name in told)])
        for state in states:
            columns = [getattr(state, name) or ("",) * len(joints) for name in told]
            at = (state.time_ns - states[0].time_ns) * 1e-9
            table.writerow(
                [f"{at:.4f}", state.mode, state.reason, *(v for row in zip(*columns, strict=True) for v in row)]
            )
    return len(states)
