"""`rigcast mirror`: live motion capture, or another's generator, through retargeting and the gate onto a stream."""

from __future__ import annotations

import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import Positional, arg

from drivers.endpoint import DEFAULT
from retarget.rig import Mount, Rig, load_rig
from rigcast import show

if TYPE_CHECKING:
    from drivers.clock import Ticker
    from drivers.frame import Frame, State
    from drivers.publisher import Publisher
    from rigcast.mirroring import Mirror
    from rigcast.service.playlist import Playlist, Row

NS = 1_000_000_000
LATE_NS = 1_000_000
NOTHING_S = 0.005  # to wait where nothing has come
NEWS_EVERY_S = 1.0  # of one kind


def mirror(
    source: Annotated[Positional[str], arg(metavar="SOURCE")],
    endpoint: Annotated[Positional[str], arg(metavar="ENDPOINT")] = DEFAULT,
    /,
    *,
    rig: str = "puppet",
    model: Path | None = None,
    mount: Mount | None = None,
    sender: Annotated[str, arg(metavar="IP")] = "",
    insecure: bool = False,
) -> int:
    """Stream what somebody shows, while they show it, as far as the gate lets it pass, until Ctrl-C.

    Whoever falls silent, or shows what the gate refuses, has the rig go to rest and hold there until poses come again.

    Args:
        source: Who shows it: vmc://:39539 hears bones of the Virtual Motion Capture protocol on this machine,
            vmc://*:39539 from others; sonic://HOST:PORT GEAR-SONIC's messages for the Unitree G1.
        endpoint: Where rigs and viewers listen.
        rig: Name of a rig (see `rigcast rigs`) or path of its folder.
        model: The rig's MJCF, where it is not where the rig looks for it.
        mount: How the base is held; it must be on a stand.
        sender: The one address whose datagrams are heard.
        insecure: Hear everybody, or stream without encryption, where other machines are reached.
    """
    from drivers.clock import MonotonicClock
    from drivers.endpoint import endpoints
    from drivers.inbox import Inbox
    from drivers.keys import keys_for
    from drivers.publisher import Publisher, require_free
    from drivers.samples import hello_for
    from drivers.signals import caught_signals
    from motiongen.motion import Source
    from retarget.trajectory import Trajectory
    from rigcast.mirroring import FPS, Line, Mirror
    from rigcast.performers import telling
    from rigcast.service.playlist import Playlist, Row
    from sim.checks import report_id

    keys = keys_for(endpoints(endpoint), insecure=insecure)
    require_free(endpoint)
    clock, playlist, news = MonotonicClock(), Playlist(), News()
    with Inbox(source, clock, sender=sender, insecure=insecure) as inbox:
        line, origin = Line(load_rig(rig, model), mount), Source(f"mirror {source}")
        still = Trajectory(line.rest_pose[None], FPS, line.rig.name, line.rig.joint_names(), source=origin)
        rest = Row(line.rest_pose, report_id(still, line.rig, line.mount), "rest")
        maker = Mirror(telling(source), inbox, line, playlist, origin, clock, news)
        hello = hello_for(still, line.rig, rest.report_id, secrets.randbits(32))
        with (
            Publisher(hello, endpoint, keys=keys, insecure=insecure, clock=clock) as publisher,
            caught_signals() as caught,
        ):
            show.warn(f"{line.rig.name} on {endpoint} mirrors {source}")
            counts, ended = play(maker, playlist, rest, line.rig, publisher, lambda: bool(caught), clock)
        refused = sum(inbox.refused.values()) + maker.counts["senseless"]
    if ended:
        show.warn(f"the stream ended before its time: {ended}")
    told = maker.counts
    print(
        f"{counts['frames']} frames, {counts['late']} late; {told['poses']} poses; {told['passed']} blocks passed, "
        f"{told['refused']} refused, {told['late']} times too late; {refused} messages not taken"
    )
    return 1 if ended or not told["poses"] else 0


class News:
    """Tells lines on stderr, of one kind once in a while."""

    def __init__(self) -> None:
        self._told_s: dict[str, float] = {}

    def __call__(self, about: str, line: str) -> None:
        now = time.monotonic()
        if now - self._told_s.get(about, -NEWS_EVERY_S) >= NEWS_EVERY_S:
            self._told_s[about] = now
            show.warn(line)


def play(
    maker: Mirror,
    playlist: Playlist,
    rest: Row,
    rig: Rig,
    publisher: Publisher,
    ended: Callable[[], bool],
    clock: Ticker,
) -> tuple[Counter[str], str]:
    """Stream `playlist`, which `maker` fills in a thread, until `ended`, then lead the rig to rest; hold where nothing
    is to be played. Returns how many frames went out, how many of them late, and why it ended before its time.

    Raises what `maker` raised.
    """
    from drivers.frame import State
    from drivers.publisher import TOO_LATE_NS
    from drivers.samples import CLOSING_FRAMES
    from rigcast.mirroring import FPS

    period, counts, stream = round(NS / FPS), Counter(frames=0, late=0), secrets.randbits(32)

    def send(row: Row, after: Row, state: State) -> None:
        publisher.send(_frame(rig, row, after, stream, counts["frames"], due, period, state))
        counts["frames"] += 1

    with _working(maker, ended) as working:
        why, due, row = "", clock.now_ns(), rest
        while not why and not (working.done() and playlist.done):
            clock.sleep_until_ns(due)
            now = clock.now_ns()
            due = now if now - due > TOO_LATE_NS else due
            counts["late"] += now - due > LATE_NS
            holding = playlist.done
            row, after = playlist.play() or (rest, rest)
            send(row, after, State.HOLD if holding else State.PLAY)
            publisher.states()
            why, due = publisher.ended(), due + period
        for _ in range(CLOSING_FRAMES):
            send(row, row, State.IDLE)
        if working.done():
            working.result()
    return counts, why


@contextmanager
def _working(maker: Mirror, ended: Callable[[], bool]) -> Iterator[Future[None]]:
    """`maker` at work in a thread until `ended` or the context is left; then it leads the rig to rest."""
    over = threading.Event()

    def work() -> None:
        while not (ended() or over.is_set()):
            if not maker.work():
                over.wait(NOTHING_S)
        maker.leave()

    with ThreadPoolExecutor(1, "mirror") as threads:
        try:
            yield threads.submit(work)
        finally:
            over.set()


def _frame(rig: Rig, row: Row, after: Row, stream: int, seq: int, due_ns: int, period_ns: int, state: State) -> Frame:
    """One sample, with the speed at which the next one will be reached."""
    from drivers.frame import Frame, State

    speed = (after.qpos[7:] - row.qpos[7:]) * (NS / period_ns) * (state == State.PLAY)
    return Frame(
        stream=stream,
        seq=seq,
        rig_hash=rig.hash,
        report_id=row.report_id,
        capture_ns=due_ns,
        due_ns=due_ns,
        period_ns=period_ns,
        pos=row.qpos[None, 7:].astype(np.float32),
        vel=speed[None].astype(np.float32),
        root=row.qpos[None, :7].astype(np.float32),
        contacts=np.zeros(1, np.uint32),
        state=state,
    )
