"""The thread that keeps a live line ahead of what is played, and does what is wished as soon as that can be."""

from __future__ import annotations

import queue
import threading
from dataclasses import dataclass

from motiongen.generator import PromptError
from motiongen.live.steering import Steer
from rigcast.service.line import FPS, Block, Line
from rigcast.service.playlist import Playlist, Row

AHEAD = round(0.6 * FPS)  # frames that are admitted ahead of the playhead, at least
POLL_S = 0.02


@dataclass(frozen=True)
class Wish:
    """What the rig shall do, under the `number` of whoever asked: a `text` for `seconds` (None: as long as such motions
    last), or to be steered; neither: to rest."""

    number: int
    text: str = ""
    seconds: float | None = None
    steer: Steer | None = None


@dataclass(frozen=True)
class Answer:
    """What became of the wish `number`: it shows from frame `first` on for `seconds`, or why it does not (`failed`).

    `rested`: the rig went to rest instead, and is steered no more. Number 0: nothing that was wished was being done.
    """

    number: int
    first: int = 0
    seconds: float = 0.0
    failed: str = ""
    rested: bool = False


class LiveMaker(threading.Thread):
    """Fills `playlist` from `line`, as it is told by `wish`; take from `answers`.

    `over`: nothing more comes. `error`: what went wrong while motion was made; the way to rest is played then.
    """

    def __init__(self, line: Line) -> None:
        super().__init__(daemon=True, name="live")
        self.line, self.playlist = line, Playlist()
        self._wishes: queue.SimpleQueue[Wish | None] = queue.SimpleQueue()
        self.answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        self.error: BaseException | None = None
        self.over = threading.Event()
        self._current = 0  # number of the wish that is being done
        self._refused = 0

    def wish(self, wish: Wish | None) -> None:
        """Do that as soon as it can be; None: lead the rig to rest, and make nothing more."""
        self._wishes.put(wish)
        self.playlist.wake()

    def run(self) -> None:
        """Until the end."""
        try:
            while not self.over.is_set():
                self.step(POLL_S)
        except BaseException as error:
            self.error = error
        self.over.set()

    def step(self, patience_s: float = 0.0) -> None:
        """Do what is wished, and make the next frames where there is room for them within `patience_s`."""
        with self.playlist.held():
            self._catch_up()
        self._obey()
        if self.over.is_set():
            return
        if self.line.changing or self.playlist.wait_below(AHEAD, patience_s, lambda: not self._wishes.empty()):
            self._put(self.line.make())

    def _obey(self) -> None:
        """Do all that was wished since; of several texts the last one that is known, as the others are over already."""
        wishes = []
        while not self._wishes.empty():
            wishes.append(self._wishes.get())
        if None in wishes:
            self._rest()
            self.over.set()
            return
        given = [w for w in wishes if w is not None]
        done = False
        for wish in reversed([w for w in given if w.steer is None]):
            if done:
                self.answers.put(Answer(wish.number, failed="something else was asked for before it began"))
            else:
                done = self._done(wish)
        for wish in given:
            if wish.steer is not None:
                self._steer(wish, wish.steer)

    def _done(self, wish: Wish) -> bool:
        """Whether that was done."""
        if not wish.text:
            self._rest()
            return True
        try:
            found = self.line.generator.familiarity(wish.text)  # takes a while, which saying it again does not
            if not found.known:
                near = ", ".join(found.nearest)
                failed = f"{wish.text!r} is far from what is known; nearest: {near}; it goes on as it was"
                self.answers.put(Answer(wish.number, failed=failed))
                return False
            seconds = self.line.generator.usual_seconds(wish.text) if wish.seconds is None else wish.seconds
            with self.playlist.held() as playhead:
                self._catch_up()
                self.line.say(wish.text, playhead, seconds=wish.seconds)
        except PromptError as error:
            self.answers.put(Answer(wish.number, failed=str(error)))
            return False
        self._current = wish.number
        self.answers.put(Answer(wish.number, self.line.frame, seconds))
        return True

    def _steer(self, wish: Wish, steer: Steer) -> None:
        try:
            with self.playlist.held() as playhead:
                self._catch_up()
                self.line.steer(steer, playhead)
        except PromptError as error:
            self.answers.put(Answer(wish.number, failed=str(error)))

    def _rest(self) -> None:
        with self.playlist.held() as playhead:
            self._catch_up()
            self._put(self.line.rest(playhead))

    def _catch_up(self) -> None:
        """Where rows ran out, the rig has taken the way to rest by itself."""
        if self.playlist.take_ran_out():
            self.line.take_way()
            self._give_up("this machine was too slow for it; the rig went to rest and goes on")

    def _put(self, block: Block) -> None:
        rows = [Row(row, block.report_id, block.text) for row in block.qpos]
        way = tuple(Row(row, block.report_id, "rest") for row in block.way)
        if not self.playlist.put(rows, way, block.first):
            with self.playlist.held() as playhead:
                if self.playlist.ran_out:
                    self.line.forget()
                else:
                    self.line.again(playhead)
        elif self.line.work.refused > self._refused:
            self._refused = self.line.work.refused
            self._give_up(f"the gate refused what was drawn ({self.line.work.why}); the rig eases to rest and goes on")

    def _give_up(self, why: str) -> None:
        self.answers.put(Answer(self._current, failed=why, rested=True))
        self._current = 0
