"""`rigcast record`, `rigcast replay`: what was on the wire to a file, and from the file to the wire."""

from __future__ import annotations

import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, UseAppendAction, arg

from drivers.endpoint import DEFAULT, StreamError
from rigcast import show

if TYPE_CHECKING:
    from drivers.mcap import McapRecorder
    from drivers.recording import Recorder, Recording

LISTENER_WAIT_S = 2.0


def record(
    file: Positional[tuple[Path, ...]],
    /,
    *,
    endpoint: Annotated[str, arg(metavar="ENDPOINT")] = DEFAULT,
    seconds: float | None = None,
    leader: str = "",
    insecure: bool = False,
) -> int:
    """Write what is on the wire to each FILE until Ctrl-C. Files that are there already are left as they are.

    Exit 1 where nothing came.

    Args:
        file: New files: .rigrec, byte for byte, for `replay`, `view` and `play`; .mcap for Foxglove and Rerun.
        endpoint: Where `say --publish` streams to.
        seconds: End after so long.
        leader: Name of the key that streams (see `rigcast keys`); by default the only one that may.
        insecure: Record a stream of another machine without keys.
    """
    from drivers.endpoint import endpoints
    from drivers.keys import keys_for
    from drivers.listen import listen
    from drivers.signals import caught_signals

    keys = keys_for(endpoints(endpoint), insecure=insecure, leader=leader)
    counts: Counter[str] = Counter()
    end = None if seconds is None else time.monotonic() + seconds
    with ExitStack() as stack:
        files: list[Recorder | McapRecorder] = []
        for path in file:
            files.append(_new_file(path, time.time_ns(), time.monotonic_ns()))
            stack.push(files[-1])
        caught = stack.enter_context(caught_signals())

        def ended() -> bool:
            return bool(caught) or (end is not None and time.monotonic() >= end)

        for each in listen(endpoint, ended, show.warner(), keys=keys, leader=leader, insecure=insecure):
            counts[each.channel.name.lower()] += 1
            for out in files:
                out.write(each)
    print(f"{', '.join(map(str, file))}: {', '.join(f'{n} {what}' for what, n in counts.items()) or 'nothing came'}")
    return 0 if counts else 1


def replay(
    file: Positional[Path],
    /,
    *,
    publish: Annotated[str | None, arg(metavar="ENDPOINT")] = None,
    out: Annotated[UseAppendAction[tuple[Path, ...]], arg(metavar="FILE")] = (),
    insecure: bool = False,
) -> int:
    """Stream a recording again, as it came, or write it as MCAP.

    Args:
        file: A recording (.rigrec).
        publish: ZeroMQ endpoint to stream to, such as tcp://127.0.0.1:5555.
        out: Write it as .mcap, for Foxglove and Rerun.
        insecure: Stream without encryption and to everybody, where other machines reach the endpoint.
    """
    from drivers.recording import Recording

    recording = Recording(file)
    if publish is None and not out:
        raise StreamError("replay where to? say --publish ENDPOINT or --out FILE.mcap")
    ended = publish is not None and _publish(recording, publish, insecure)
    for path in out:
        with _new_file(path, recording.utc_ns, recording.monotonic_ns) as written:
            for each in recording:
                written.write(each)
        print(f"wrote {path}")
    warn_of_lost(file, recording)
    return 1 if ended else 0


def warn_of_lost(path: Path, recording: Recording) -> None:
    """Warn where the end of a recording, which was read, could not be."""
    if recording.lost:
        show.warn(f"{path}: its last {recording.lost} bytes are cut off or damaged; what comes before them is whole")


def _publish(recording: Recording, endpoint: str, insecure: bool) -> str:
    """Why the stream ended before its time, "" where it did not."""
    from drivers.endpoint import endpoints
    from drivers.keys import keys_for
    from drivers.publisher import Publisher
    from drivers.recorded import hello_in
    from drivers.replay import replay as run

    keys = keys_for(endpoints(endpoint), insecure=insecure)
    with Publisher(hello_in(recording), endpoint, keys=keys, insecure=insecure) as publisher:
        done = run(recording, publisher, LISTENER_WAIT_S)
    if not done.heard:
        show.warn(f"nobody listened on {endpoint}; start `rigcast view` or `rigcast drive` first")
    print(f"{done.frames} frames and {done.stops} stops sent, {done.left_out} damaged ones left out")
    if done.ended:
        show.warn(f"the stream ended before its time: {done.ended}")
    return done.ended


def _new_file(path: Path, utc_ns: int, monotonic_ns: int) -> Recorder | McapRecorder:
    from drivers.recording import SUFFIX, Recorder

    if path.suffix == SUFFIX:
        return Recorder(path)
    if path.suffix == ".mcap":
        from drivers.mcap import McapRecorder

        return McapRecorder(path, utc_ns, monotonic_ns)
    raise StreamError(f"{path}: unknown suffix; a recording is {SUFFIX} or .mcap")
