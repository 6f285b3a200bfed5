"""`rigcast say --live`: a prompt at which each typed line takes effect at once, on a stream without end."""

from __future__ import annotations

import queue
import secrets
import sys
import threading
from collections.abc import Callable, Iterable
from itertools import chain

import numpy as np

from drivers.clock import MonotonicClock, Ticker
from drivers.endpoint import DEFAULT, endpoints
from drivers.frame import Frame, State
from drivers.keys import Keys, keys_for
from drivers.messages import Hello
from drivers.publisher import TOO_LATE_NS, Publisher, require_free
from drivers.samples import CLOSING_FRAMES, hello_for
from drivers.signals import caught_signals
from motiongen.diffusion.weights import weights_path
from motiongen.generator import PromptError, check_prompt
from motiongen.live.generator import LiveGenerator
from motiongen.motion import Source
from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from rigcast.delivery import Delivery
from rigcast.service.line import FPS, Block, Line
from rigcast.service.playlist import Playlist, Row
from sim.checks import report_id

NS = 1_000_000_000
PERIOD_NS = round(NS / FPS)
AHEAD_S = 0.6  # that is admitted ahead of the playhead; what is said later takes back what was not played
START_S = 0.4  # admitted before the first frame goes out
POLL_S = 0.02
REST = ":rest"


class Maker(threading.Thread):
    """Keeps `playlist` filled from `line`, and obeys what is put into `said`: a text, `REST`, or None for the end."""

    def __init__(self, line: Line, playlist: Playlist, tell: Callable[[str], None]) -> None:
        super().__init__(daemon=True)
        self.said: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self.failed: BaseException | None = None
        self.over = threading.Event()
        self._line, self._playlist, self._tell = line, playlist, tell
        self._refused = 0

    def run(self) -> None:
        """Until the rig rests after None was said; what goes wrong is kept in `failed`."""
        try:
            while not self.over.is_set():
                with self._playlist.held():
                    self._catch_up()
                self._obey()
                if self._playlist.wait_below(round(AHEAD_S * FPS), POLL_S) and not self.over.is_set():
                    self._put(self._line.make())
        except BaseException as error:  # the player takes the way to rest meanwhile
            self.failed = error
            self.over.set()

    def _obey(self) -> None:
        try:
            text = self.said.get_nowait()
        except queue.Empty:
            return
        if text is None or text == REST:
            with self._playlist.held() as playhead:
                self._catch_up()
                block = self._line.rest(playhead)
                self._playlist.cut(block.first, ())
                self._put(block)
            if text is None:
                self.over.set()
            return
        try:
            found = self._line.generator.familiarity(text)  # takes a while, which saying it again does not
            if not found.known:
                near = ", ".join(found.nearest)
                self._tell(f"{text!r} is far from what is known; nearest: {near}; it goes on as it was")
                return
            with self._playlist.held() as playhead:
                self._catch_up()
                self._line.say(text, playhead)
                self._playlist.cut(self._line.frame, self._way())
        except PromptError as error:
            self._tell(str(error))

    def _catch_up(self) -> None:
        """Where rows ran out, the rig has taken the way to rest by itself."""
        if self._playlist.take_ran_out():
            self._line.take_way()

    def _put(self, block: Block) -> None:
        rows = [Row(row, block.report_id, block.text) for row in block.qpos]
        if not self._playlist.put(rows, self._way()):
            self._line.forget()
        elif self._line.work.refused > self._refused:
            self._refused = self._line.work.refused
            self._tell(f"the gate refused what was drawn ({self._line.work.why}); the rig eases to rest and goes on")

    def _way(self) -> tuple[Row, ...]:
        return tuple(Row(row, self._line.way_id, "rest") for row in self._line.way)


def prompt(rig: Rig, mount: Mount | None, delivery: Delivery, *, text: str | None, generator: str, seed: int) -> int:
    """Stream what is typed on stdin, beginning with `text`, until its end or Ctrl-C; exit code 0.

    Raises ValueError for a rig that is not on a stand and for deliveries that end, PromptError for a text that nobody
    could follow, WeightsError, StreamError, and whatever making motion raised.
    """
    if delivery.out or delivery.view != "none" or delivery.rate is not None or delivery.unchecked or delivery.json:
        raise ValueError(
            "--live streams at 50 Hz what has passed, and nothing else: --publish and --insecure go with it"
        )
    address = delivery.publish or DEFAULT
    keys = keys_for(endpoints(address), insecure=delivery.insecure)
    require_free(address)
    lines = [] if text is None else [check_prompt(text)]
    line = Line(LiveGenerator(weights_path(generator), seed=seed), rig, mount)
    source = Source(line.generator.name, line.generator.digest, seed, line.generator.licence)
    still = Trajectory(line.rest_pose[None], FPS, rig.name, rig.joint_names(), source=source)
    hello = hello_for(still, rig, report_id(still, rig, line.mount), secrets.randbits(32))
    with caught_signals() as caught:
        print(f"{rig.name} idles on {address}; say what it shall do, or {REST}", file=sys.stderr, flush=True)
        typed = chain(lines, sys.stdin)
        sent = play(line, hello, address, typed, keys=keys, insecure=delivery.insecure, stopped=lambda: bool(caught))
    took = ", ".join(f"{name} {seconds / (sent / FPS):.2f}" for name, seconds in line.work.seconds.items())
    print(f"{sent} frames; {line.work.refused} blocks refused; seconds of work a second of motion: {took}")
    return 0


def play(
    line: Line,
    hello: Hello,
    address: str,
    lines: Iterable[str],
    *,
    keys: Keys | None,
    insecure: bool,
    stopped: Callable[[], bool],
    clock: Ticker | None = None,
    tell: Callable[[str], None] = lambda text: print(text, file=sys.stderr),
) -> int:
    """Stream `line` to `address` until `lines` end or `stopped`; then the rig is led to rest. How many frames went out.

    Raises StreamError as a Publisher does, and what making blocks raised.
    """
    clock = clock or MonotonicClock()
    playlist = Playlist()
    maker = Maker(line, playlist, tell)
    with Publisher(hello, address, keys=keys, insecure=insecure, clock=clock) as publisher:
        maker.start()
        while playlist.wait_below(round(START_S * FPS), 0):
            if maker.failed is not None:
                raise maker.failed
            publisher.tick()
            clock.sleep_until_ns(clock.now_ns() + PERIOD_NS)
        threading.Thread(target=_listen, args=(lines, maker.said), daemon=True).start()
        sent, due, leaving = 0, clock.now_ns(), False
        stream = secrets.randbits(32)
        while True:
            clock.sleep_until_ns(due)
            if stopped() and not leaving:
                leaving = True
                maker.said.put(None)
            if maker.over.is_set() and playlist.done:
                break
            if (now := clock.now_ns()) - due > TOO_LATE_NS:
                due = now
            row, after = _played(playlist)
            publisher.send(_frame(line.rig, row, after, stream, sent, due, State.PLAY))
            publisher.states()
            sent, due = sent + 1, due + PERIOD_NS
        for _ in range(CLOSING_FRAMES):
            publisher.send(_frame(line.rig, row, row, stream, sent, due, State.IDLE))
            sent, due = sent + 1, due + PERIOD_NS
            clock.sleep_until_ns(due)
    if maker.failed is not None:
        raise maker.failed
    return sent


def _listen(lines: Iterable[str], said: queue.SimpleQueue[str | None]) -> None:
    for text in lines:
        if text.strip():
            said.put(text.strip())
    said.put(None)


def _played(playlist: Playlist) -> tuple[Row, Row]:
    played = playlist.play()
    if played is None:
        raise RuntimeError("nothing was admitted before the first frame was due")
    return played


def _frame(rig: Rig, row: Row, after: Row, stream: int, seq: int, due_ns: int, state: State) -> Frame:
    """One sample, with the speed at which the next one will be reached."""
    speed = (after.qpos[7:] - row.qpos[7:]) * FPS
    return Frame(
        stream=stream,
        seq=seq,
        rig_hash=rig.hash,
        report_id=row.report_id,
        capture_ns=due_ns,
        due_ns=due_ns,
        period_ns=PERIOD_NS,
        pos=row.qpos[None, 7:].astype(np.float32),
        vel=speed[None].astype(np.float32),
        root=row.qpos[None, :7].astype(np.float32),
        contacts=np.zeros(1, np.uint32),
        state=state,
    )
