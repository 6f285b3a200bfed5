"""The live service: prompts in, a stream without end out, and nothing on it that has not passed the gate.

One thread, one cycle a frame. What takes longer than a frame is done by two makers, processes of their own: one draws
and judges motions, the other judges what is to be cut short.
"""

from __future__ import annotations

import secrets
from collections import Counter
from pathlib import Path

from drivers.clock import Ticker
from drivers.control import Rest, Say, Status, Told
from drivers.frame import State
from drivers.publisher import TOO_LATE_NS, Caller, Publisher
from drivers.samples import CLOSING_FRAMES, frame_at, hello_for
from retarget.rig import Rig
from rigcast.service.desk import Desk, Settings
from rigcast.service.making import Cut, Made, Make
from rigcast.service.player import IDLE, Part, Player, part_of
from rigcast.service.workshop import Workshop

NS = 1_000_000_000
LATE_NS = 1_000_000
AHEAD = 2  # passed motions that wait to be played; more of them would only be older
LEAD_S = (0.4, 4.0)  # how far ahead a motion is cut: as long as the gate needs, by the last time
NOT_WORTH_S = 1.5  # a motion that ends within so long is not cut short: that takes as long


class Service:
    """Streams `idle` and what is asked for through `publisher`; call `cycle` until `over`, then `finish`."""

    def __init__(
        self,
        rig: Rig,
        publisher: Publisher,
        idle: Part,
        maker: Workshop,
        cutter: Workshop,
        settings: Settings,
        clock: Ticker,
    ) -> None:
        self._rig, self._publisher, self._settings, self._clock = rig, publisher, settings, clock
        self._maker, self._cutter = maker, cutter
        self._player = Player(idle, rig)
        self._desk = Desk(rig.name, publisher, settings, clock)
        self._orders = self._desk.orders
        self._shown: Part | None = None
        self._cutting: tuple[Part, float] | None = None  # which part, and at which second of it
        self._lead_s = LEAD_S[0]
        self._cut_asked_ns = 0
        self._hurry = False  # what plays has to give way, also where nothing waits
        self._stream, self._seq, self._next_ns = secrets.randbits(32), 0, clock.now_ns()
        self._samples, self._at = self._player.next()
        self.counts: Counter[str] = Counter(frames=0, late=0, cuts=0, cuts_rejected=0)

    @property
    def outcomes(self) -> dict[str, int]:
        """How many prompts ended how."""
        return {str(event): count for event, count in self._orders.outcomes.items()}

    @property
    def over(self) -> bool:
        """Whether the rig is at rest after `leave`, or was stopped since."""
        return self._desk.leaving and bool(self._publisher.stopped or self._player.left_s <= 0)

    def cycle(self) -> None:
        """Wait until the next frame is due, send it, and see to what has come meanwhile."""
        self._clock.sleep_until_ns(self._next_ns)
        now = self._clock.now_ns()
        if now - self._next_ns > TOO_LATE_NS:
            self._next_ns = now  # the machine stood still, and so did the motion
        self.counts["late"] += now - self._next_ns > LATE_NS
        self._send()
        self._publisher.states()
        for caller, request in self._desk.requests(self.status):
            self._answer(caller, request)
        if self._desk.fell_ill():
            self._let_go(self._desk.unwell)
        self._make()
        self._cut(now)

    def leave(self, why: str) -> None:
        """Take nothing more, and lead what plays back to rest."""
        self._desk.leaving = self._hurry = True
        self._let_go(why)

    def finish(self) -> None:
        """Tell the rigs that the stream is over."""
        for _ in range(CLOSING_FRAMES):
            self._send(State.IDLE)

    def status(self, id: str = "") -> Status:
        """How things stand."""
        return self._desk.status(id, self._orders.get(self._player.part.number), self._player.left_s)

    def _send(self, state: State = State.PLAY) -> None:
        due = self._next_ns
        self._next_ns += round(NS / self._settings.rate_hz)
        if state == State.PLAY and self._publisher.stopped:
            state = State.SAFE
        if state == State.PLAY:
            self._samples, self._at = self._player.next()
            if self._player.part is not self._shown:
                self._begun(self._player.part)
        report_id = self._player.part.report_id
        frame = frame_at(
            self._samples, self._at, self._rig, report_id, stream=self._stream, seq=self._seq, due_ns=due, state=state
        )
        self._seq += 1
        self.counts["frames"] += 1
        self._publisher.send(frame)

    def _begun(self, part: Part) -> None:
        """`part` has taken the place of `_shown`, or is it cut short."""
        before, self._shown = self._shown, part
        self._publisher.hello = hello_for(part.trajectory, self._rig, part.report_id, self._stream)
        if before is not None and before.number == part.number != IDLE:
            return
        if before is not None and (order := self._orders.get(before.number)) is not None:
            self._orders.came_to(order, *(("dropped", "it gave way") if before.final else ("played",)))
        if before is not None and before.number != IDLE:
            before.path.unlink(missing_ok=True)
        if (order := self._orders.get(part.number)) is not None:
            self._orders.came_to(order, "playing")
        if not part.final:
            self._hurry = self._desk.leaving

    def _answer(self, caller: Caller, request: Say | Rest) -> None:
        if isinstance(request, Rest):
            self._let_go(f"{caller.name} asked for rest")
            self._publisher.tell(caller, Told(request.id, "resting"))
            return
        if request.replace:
            self._let_go(f"{caller.name} asked for {request.text[:100]!r} instead", but_what_plays=True)
        self._orders.add(caller, request)

    def _let_go(self, why: str, *, but_what_plays: bool = False) -> None:
        """Drop what was asked for; what plays goes on until it can give way."""
        playing = self._orders.get(self._player.part.number)
        for part in self._player.waiting:
            part.path.unlink(missing_ok=True)
        self._player.waiting.clear()
        self._orders.drop(why, keep=playing if but_what_plays else None)
        self._hurry = self._hurry or (playing is not None and not but_what_plays)

    def _make(self) -> None:
        if self._maker.busy:
            if (made := self._maker.done()) is not None:
                self._made(made)
            return
        order = self._orders.next_to_make()
        if order is not None and len(self._player.waiting) < AHEAD:
            say = order.say
            self._maker.ask(Make(order.number, say.text, say.seconds, say.seed, say.guidance))
            self._orders.came_to(order, "making")

    def _made(self, made: Made) -> None:
        order = self._orders.get(made.number)
        if order is None:
            if made.ok:
                Path(made.path).unlink(missing_ok=True)
        elif not made.ok:
            self._orders.came_to(order, "rejected", made.detail, made)
        else:
            self._player.waiting.append(part_of(made.number, Path(made.path), made.report_id, self._settings.rate_hz))
            self._orders.came_to(order, "ready", made.detail, made)
            self._hurry = self._hurry or order.say.replace

    def _cut(self, now: int) -> None:
        """Have what plays give way, where something is to come in its place."""
        if self._cutter.busy:
            if (made := self._cutter.done()) is not None:
                self._cut_came(made, now)
            return
        part, left_s = self._player.part, self._player.left_s
        wanted = self._hurry or (part.number == IDLE and bool(self._player.waiting))
        if not wanted or part.final or left_s < self._lead_s + NOT_WORTH_S:
            return
        frame = int((self._player.at_s + self._lead_s) * part.checked_fps)
        self._cutting, self._cut_asked_ns = (part, frame / part.checked_fps), now
        self._cutter.ask(Cut(self._orders.new_number(), str(part.path), frame))

    def _cut_came(self, made: Made, now: int) -> None:
        """The cut that was asked for; where the gate says no, or it comes too late, another one is tried further on."""
        cutting, self._cutting = self._cutting, None
        taken_s = (now - self._cut_asked_ns) / NS
        self._lead_s = min(max(1.5 * taken_s, LEAD_S[0]), LEAD_S[1])
        if cutting is None:
            return
        if not made.ok:
            self.counts["cuts_rejected"] += 1
            return
        of, at_s = cutting
        shorter = part_of(of.number, Path(made.path), made.report_id, self._settings.rate_hz)
        self.counts["cuts"] += self._player.give_way(shorter, of, at_s)
        Path(made.path).unlink(missing_ok=True)


def idle_part(made: Made, rate_hz: float) -> Part:
    """The idle motion that a maker made, as a part. Raises RuntimeError with what the gate said where it made none."""
    if not made.ok:
        raise RuntimeError(f"the rig cannot even stand idle: {made.detail}")
    return part_of(IDLE, Path(made.path), made.report_id, rate_hz)
