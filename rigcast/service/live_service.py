"""The service over a live line: a prompt changes what the rig does at once, and nothing begins or ends at rest.

One thread, one cycle a frame; another one, a `LiveMaker`, keeps ahead of it. Beside the control socket it takes lines
from whoever sits at the machine, who need not wait for anybody.
"""

from __future__ import annotations

import queue
from collections import Counter
from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from drivers.clock import Ticker
from drivers.control import Answer as Said
from drivers.control import Rest, Say, Status, Told
from drivers.frame import Frame, State
from drivers.publisher import TOO_LATE_NS, Caller, Publisher
from drivers.samples import CLOSING_FRAMES
from motiongen.generator import PromptError, check_prompt
from motiongen.live.steering import Steer
from motiongen.live.steering_words import steered
from retarget.rig import Rig
from rigcast.service.desk import Desk, Settings
from rigcast.service.line import FPS
from rigcast.service.live_maker import Answer, LiveMaker, Wish
from rigcast.service.making import Made
from rigcast.service.orders import Order
from rigcast.service.playlist import Row

NS = 1_000_000_000
PERIOD_NS = round(NS / FPS)
LATE_NS = 1_000_000
EARLY = round(0.25 * FPS)  # frames before one text ends that the next is wished for: about what it takes to come
HERE = Caller(b"", "here")  # who types
REST = ":rest"
OF_CLIPS = "seed and guidance are for generators that draw whole clips; this one draws on and on"


class LiveService:
    """Streams what `maker` makes through `publisher`; call `cycle` until `over`, then `finish`.

    `typed` takes lines at any time, from any thread; `told` hears what became of them.
    """

    def __init__(
        self,
        publisher: Publisher,
        maker: LiveMaker,
        settings: Settings,
        clock: Ticker,
        told: Callable[[Told], None] = lambda said: None,
    ) -> None:
        self.typed: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._rig: Rig = maker.line.rig
        self._publisher, self._maker, self._clock, self._told = publisher, maker, clock, told
        self._desk = Desk(self._rig.name, publisher, settings, clock, self._tell)
        self._orders = self._desk.orders
        self._doing = 0  # number of the order whose text is shown, or comes next
        self._spans: dict[int, tuple[int, int]] = {}  # order → its first row, and the one after its last
        self._steer = Steer()
        self._complaint = ""  # what was told last of what nobody asked for
        self._played: tuple[Row, Row] | None = None
        self._row = 0  # number of the next row
        self._stream, self._seq, self._next_ns = publisher.hello.stream, 0, clock.now_ns()
        self.counts: Counter[str] = Counter(frames=0, late=0, cuts=0, cuts_rejected=0)

    @property
    def outcomes(self) -> dict[str, int]:
        """How many prompts ended how."""
        return {str(event): count for event, count in self._orders.outcomes.items()}

    @property
    def over(self) -> bool:
        """Whether the rig is at rest after `leave` or a failure, or was stopped since."""
        ends = self._maker.over.is_set() or self._desk.leaving
        return ends and bool(self._publisher.stopped or (self._maker.over.is_set() and self._maker.playlist.done))

    @property
    def busy(self) -> bool:
        """Whether anything that was asked for is still to be shown."""
        return bool(len(self._orders)) or not self.typed.empty()

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
            self._take(caller, request)
        while not self.typed.empty():
            self._take_typed(self.typed.get())
        if self._desk.fell_ill():
            self._rest(self._desk.unwell)
        while not self._maker.answers.empty():
            self._answered(self._maker.answers.get())
        self._show()
        self._next()

    def leave(self, why: str) -> None:
        """Take nothing more, and lead the rig to rest."""
        self._desk.leaving = True
        self._orders.drop(why)
        self._maker.wish(None)

    def finish(self) -> None:
        """Tell the rigs that the stream is over."""
        for _ in range(CLOSING_FRAMES):
            self._send(State.IDLE)

    def status(self, id: str = "") -> Status:
        """How things stand."""
        playing = self._orders.get(self._doing)
        shown = playing if playing is not None and playing.event == "playing" else None
        return self._desk.status(id, shown, max(0.0, (self._spans.get(self._doing, (0, 0))[1] - self._row) / FPS))

    def _tell(self, caller: Caller, said: Said) -> None:
        if caller is not HERE:
            self._publisher.tell(caller, said)
        elif isinstance(said, Told):
            self._told(said)

    def _send(self, state: State = State.PLAY) -> None:
        due = self._next_ns
        self._next_ns += PERIOD_NS
        if state == State.PLAY and self._publisher.stopped:
            state = State.SAFE
        if state == State.PLAY:
            self._played, self._row = self._maker.playlist.play(), self._maker.playlist.playhead
        if self._played is None:
            raise RuntimeError("nothing was admitted before the first frame was due")
        self._publisher.send(_frame(self._rig, *self._played, self._stream, self._seq, due, state))
        self._seq += 1
        self.counts["frames"] += 1

    def _take_typed(self, line: str) -> None:
        request = Rest(REST) if line == REST else Say(line[:60], line, replace=True)
        if objection := self._desk.objection(request):
            self._orders.refuse(HERE, request.id, objection)
        else:
            self._take(HERE, request)

    def _take(self, caller: Caller, request: Say | Rest) -> None:
        """What may be asked for; a text that nobody could follow is refused here."""
        if isinstance(request, Rest):
            self._rest(f"{caller.name} asked for rest")
            self._tell(caller, Told(request.id, "resting"))
            return
        try:
            if request.seed or request.guidance is not None:
                raise PromptError(OF_CLIPS)
            check_prompt(request.text, request.seconds)
            steer = steered(request.text, self._steer)
            if steer is not None:
                steer.require_within(self._maker.line.generator.area)
        except PromptError as error:
            self._orders.refuse(caller, request.id, str(error))
            return
        if steer is not None:
            self._steer = steer
            self._maker.wish(Wish(0, steer=steer))
            self._tell(caller, Told(request.id, "played", "from now on"))
            return
        order = self._orders.add(caller, request)
        if request.replace:
            self._ask(order)

    def _rest(self, why: str) -> None:
        self._orders.drop(why)
        self._doing, self._steer = 0, Steer()
        self._maker.wish(Wish(0))

    def _next(self) -> None:
        """Wish for the next text where the one before it is over, or about to be."""
        doing = self._orders.get(self._doing)
        if doing is not None and self._row < self._spans.get(self._doing, (0, 1 << 62))[1] - EARLY:
            return
        if (order := self._orders.next_to_make()) is not None:
            self._doing = order.number
            self._ask(order)

    def _ask(self, order: Order) -> None:
        self._orders.came_to(order, "making")
        self._maker.wish(Wish(order.number, order.say.text, order.say.seconds))

    def _answered(self, answer: Answer) -> None:
        order = self._orders.get(answer.number)
        if answer.rested:
            self._steer = Steer()
            if order is None and answer.failed != self._complaint:  # once, however often it happens again
                self._told(Told("", "dropped", answer.failed[:1000]))
            self._complaint = answer.failed
        if order is None:
            return
        if answer.failed:
            self._orders.came_to(order, "rejected", answer.failed)
        else:
            if order.say.replace:  # not before, as what is not known changes nothing
                self._orders.drop(f"{order.caller.name} asked for {order.say.text[:100]!r} instead", keep=order)
                self._doing = order.number
            self._complaint = ""
            self._spans[order.number] = answer.first, answer.first + round(answer.seconds * FPS)
            self._orders.came_to(order, "ready", made=Made(order.number, ok=True, seconds=answer.seconds))

    def _show(self) -> None:
        """Tell whose frames go out, and whose have gone out."""
        for number, (first, end) in list(self._spans.items()):
            order = self._orders.get(number)
            if order is None:
                del self._spans[number]
                self.counts["cuts"] += self._row > first
            elif order.event == "ready" and self._row > first:
                self._orders.came_to(order, "playing")
                self._publisher.hello = replace(self._publisher.hello, text=order.say.text)
            elif order.event == "playing" and self._row > end:
                del self._spans[number]
                self._orders.came_to(order, "played")


def _frame(rig: Rig, row: Row, after: Row, stream: int, seq: int, due_ns: int, state: State) -> Frame:
    """One sample, with the speed at which the next one will be reached."""
    speed = (after.qpos[7:] - row.qpos[7:]) * FPS if state == State.PLAY else np.zeros(len(row.qpos) - 7)
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
