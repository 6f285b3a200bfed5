"""The line while it runs: chunks are drawn, retargeted and gated ahead of the playhead, and drawn anew when told so.

Work is retargeted in steps and gated in blocks of a few. Each block passes together with a way to rest from its end, so
whatever has been admitted can be played, and then stopped. Something else can begin after any step: it is made beside
what was admitted, and takes its place once it has passed. Where a block fails, the rig takes the way to rest from the
end of what was admitted, and begins again from there.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from motiongen.generator import Familiarity
from motiongen.live.generator import Kept, LiveGenerator
from motiongen.live.steering import Steer
from motiongen.motion import Motion, cut
from retarget.incoming import joined
from retarget.rig import Mount, Rig
from retarget.streaming import Progress, open_stream, turned
from retarget.trajectory import Trajectory
from sim.ahead import Gate, Moment, Verdict
from sim.checks import report_id

FPS = 50.0  # frames a second on the wire
MOTION_FPS = 30.0  # of human motion
STEP = 3  # frames of human motion, 0.1 s, after each of which something else can begin
BLOCK = 4  # steps that are gated together: a way to rest costs as much as 1 s of motion
FIRST = 2  # steps of the first two blocks of something else, for which time is short; those behind grow by one each
LOOK_AHEAD_S = 0.1  # that retargeting sees of what comes
EACH = 3  # frames that go out of each solution: 65% of the work; joints are elsewhere by 0.005 rad (rms)
LEAD_S = 0.1  # at least, from what is said to the first frame that it can change
LEAD_SHARE = 1.2  # times what it took to make the first block of something else
CAUTION = 0.7  # of what that took the time before is expected at least: the rig rests where a block comes too late
PAST_S = 2.0  # of frames that are remembered

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Block:
    """Frames `qpos` (n, 7 + nj) from frame `first` on that have passed the gate as `report_id`, showing `text`, and the
    `way` (m, 7 + nj) to rest from their end."""

    first: int
    qpos: Array
    way: Array
    report_id: str
    text: str


@dataclass(frozen=True)
class _Point:
    """Where something else can begin: the number of the next frame, of the generator's next frame that retargeting has
    not seen, and what stays of each stage."""

    frame: int
    drawn: int
    progress: Progress
    moment: Moment


@dataclass(frozen=True)
class _End:
    """Where a block ends, at `frame`; `rested`: the moment at the end of its way."""

    frame: int
    block: Block
    rested: Moment


@dataclass(frozen=True)
class _Step:
    """Frames before the gate, with the progress and the generator's frame after them, and what is done in them."""

    qpos: Array
    progress: Progress
    drawn: int
    text: str


@dataclass
class Work:
    """Seconds that each stage took, blocks that the gate refused, and why the last one was."""

    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    refused: int = 0
    why: str = ""


class Line:
    """What a rig on a stand is to do next, made by `make` block by block; `say`, `steer` and `rest` change it at once.

    Raises RigError for the rig's files, ValueError where it is not on a stand.
    """

    def __init__(
        self,
        generator: LiveGenerator,
        rig: Rig,
        mount: Mount | None = None,
        *,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.generator, self.rig, self.work = generator, rig, Work()
        self.mount: Mount = rig.mount if mount is None else mount
        self._clock = clock
        self._stream, self._opened = open_stream(
            rig, generator.skeleton, MOTION_FPS, mount=self.mount, fps=FPS, look_ahead=LOOK_AHEAD_S, each=EACH
        )
        self._gate = Gate(rig, self.rest_pose, FPS, self.mount)
        self._second = ThreadPoolExecutor(1, "gate")
        begun, nothing = self._gate.begin(), self.rest_pose[None][:0]
        self._ends = [_End(0, Block(0, nothing, nothing, self._id(self.rest_pose[None]), "rest"), begun)]
        self._ends_before = self._ends  # the last block was made
        self._points = [_Point(0, generator.frame, self._opened, begun)]
        self._kept = self._points, generator.kept()  # before something else was asked for
        self._asked: list[tuple[str, float | None] | Steer] = []  # what, since then
        self._turn: _Point | None = None  # where something else begins; the last point is what it has seen
        self._pending: Motion | None = None  # drawn and not yet retargeted
        self._ready: list[_Step] = []  # of the next block
        self._steps = FIRST  # of the next block
        self._asked_s: float | None = clock()  # when something else was asked for that has not begun
        self._took_s = 0.0  # from there to its first block, the last time or the times before

    @property
    def rest_pose(self) -> Array:
        """(7 + nj,): where it begins, and where every way leads."""
        return self._stream.nominal

    @property
    def frame(self) -> int:
        """Number of the next frame that is to be made."""
        return self._from.frame

    @property
    def changing(self) -> bool:
        """Whether the next block takes the place of frames that were admitted."""
        return self._turn is not None

    def say(self, text: str, playhead: int, *, seconds: float | None = None) -> Familiarity:
        """Do `text` as soon as that can be after the frame `playhead`; see `LiveGenerator.say`."""
        point, seen = self._after(playhead)
        kept = self._points, self.generator.kept()
        found = self.generator.say(text, self._points[seen].drawn, seconds=seconds)
        if found.known:
            self._turn_at(point, seen, (text, seconds), kept)
        return found

    def steer(self, steer: Steer, playhead: int) -> None:
        """Steer from as soon after `playhead` as can be; see `LiveGenerator.steer`."""
        point, seen = self._after(playhead)
        kept = self._points, self.generator.kept()
        self.generator.steer(steer, self._points[seen].drawn)
        self._turn_at(point, seen, steer, kept)

    def rest(self, playhead: int) -> Block:
        """The way to rest, which has passed already, from the first end of a block after `playhead`; then it idles."""
        later = [i for i, end in enumerate(self._ends) if end.frame >= playhead]
        self._ends = self._ends[: later[0] + 1] if later else self._ends
        return self.take_way()

    def make(self) -> Block:
        """The next block that may be played. Where the gate refuses what was drawn, that is the way to rest.

        While the gate looks at it, what comes after it is drawn and retargeted: of two cores each has its work. But
        only a step where somebody waits for the block.
        """
        point, asked_s = self._from, self._asked_s
        steps = self._stepped(self._ready, self._steps)
        qpos, marks = np.concatenate([step.qpos for step in steps]), list(accumulate(len(step.qpos) for step in steps))
        judging = self._second.submit(self._judged, point.moment, qpos, marks[:-1])
        self._steps = FIRST if asked_s is not None else min(len(steps) + 1, BLOCK)
        self._ready = self._stepped(steps[-1:], 1 + (self._steps if asked_s is None else 1))[1:]
        verdict = judging.result()
        if asked_s is not None:
            self._took_s, self._asked_s = max(self._clock() - asked_s, CAUTION * self._took_s), None
        if not verdict.ok:
            self.work.refused += 1
            self.work.why = "; ".join(check.advice for check in verdict.failures)
            return self.take_way()
        block = Block(point.frame, qpos, verdict.way, self._id(np.concatenate([qpos, verdict.way])), steps[0].text)
        self._ends_before, end = self._ends, _End(point.frame + len(qpos), block, verdict.rested)
        self._ends = [e for e in self._ends if point.frame - PAST_S * FPS < e.frame <= point.frame] + [end]
        moments = (*verdict.moments, verdict.after)
        self._points += [
            _Point(point.frame + mark, step.drawn, step.progress, moment)
            for mark, step, moment in zip(marks, steps, moments, strict=True)
        ]
        self._turn = None
        self._points = [p for p in self._points if p.frame > end.frame - PAST_S * FPS]
        return block

    def forget(self) -> None:
        """The last block came too late, and what was admitted before it goes on to its end: see `take_way`."""
        self._ends = self._ends_before

    def again(self, playhead: int) -> None:
        """The last block came too late to take the place of what was admitted, and that goes on: what was asked for is
        made once more, further ahead, as it is known by now how long that takes."""
        self.forget()
        asked = self._asked
        self._points, kept = self._kept
        self.generator.return_to(kept)
        self._begin_anew(None)
        for each in asked:
            if isinstance(each, Steer):
                self.steer(each, playhead)
            else:
                self.say(each[0], playhead, seconds=each[1])

    def take_way(self) -> Block:
        """The way to rest from the end of all that was admitted; behind it the rig idles, and is steered no more."""
        end, drawn = self._ends[-1], min(self._points[-1].drawn, self.generator.frame)
        way = end.block.way if len(end.block.way) else self.rest_pose[None]
        self.generator.idle(drawn)
        self.generator.steer(Steer(), drawn)
        block = Block(end.frame, way, way[:0], end.block.report_id, "rest")
        self._ends = self._ends_before = [_End(end.frame + len(way), block, end.rested)]
        self._points = [_Point(end.frame + len(way), drawn, self._opened, end.rested)]
        self._begin_anew(None)
        return block

    @property
    def _from(self) -> _Point:
        """Where the next block begins."""
        return self._turn or self._points[-1]

    def _stepped(self, steps: list[_Step], count: int) -> list[_Step]:
        """`steps`, and as many after them as there are to be."""
        steps = list(steps)
        while len(steps) < count:
            steps.append(self._step(steps[-1] if steps else None))
        return steps

    def _step(self, before: _Step | None) -> _Step:
        """What comes after a step, or where the next block begins."""
        progress = before.progress if before else self._from.progress
        seen, drawn = (before.progress, before.drawn) if before else (self._points[-1].progress, self._points[-1].drawn)
        count = 2 * STEP if self.changing and before is None else STEP  # as much has gone out unseen, up to a step
        while True:
            began = self._clock()
            motion = self._pending or self.generator.next_chunk()
            while len(motion) < count:
                motion = joined(motion, self.generator.next_chunk())
            self.work.seconds["generate"] += (drew := self._clock()) - began
            self._pending = cut(motion, count, len(motion)) if len(motion) > count else None
            progress, streamed = turned(self._stream, progress, seen, cut(motion, 0, count))
            self.work.seconds["retarget"] += self._clock() - drew
            seen, drawn = progress, drawn + count
            if len(streamed.qpos):
                return _Step(streamed.qpos, progress, drawn, motion.labels[0].text)

    def _judged(self, moment: Moment, qpos: Array, marks: list[int]) -> Verdict:
        began = self._clock()
        verdict = self._gate.judge(moment, qpos, marks)
        self.work.seconds["gate"] += self._clock() - began
        return verdict

    def _after(self, playhead: int) -> tuple[_Point, int]:
        """The first point that is far enough ahead, else the last; and the number of the one at which retargeting had
        seen the motion up to there, to the nearest step, and not what it looks at ahead."""
        wanted = playhead + round(max(LEAD_S, LEAD_SHARE * self._took_s) * FPS)
        point = next((p for p in self._points if p.frame >= wanted), self._from)
        shown = point.progress.done / FPS  # s since the stream was opened
        ahead = [p.progress.incoming.received / MOTION_FPS - shown for p in self._points]
        seen = min(range(len(ahead)), key=lambda i: abs(ahead[i]))
        return point, seen

    def _turn_at(
        self,
        point: _Point,
        seen: int,
        asked: tuple[str, float | None] | Steer,
        kept: tuple[list[_Point], Kept],
    ) -> None:
        """Go on from a point, with what retargeting had seen at another; `kept` from before it was `asked` for."""
        if not self.changing:
            self._kept, self._asked = kept, []
        self._asked.append(asked)
        self._points = self._points[: seen + 1]
        self._begin_anew(point)
        self._asked_s = self._clock()

    def _begin_anew(self, turn: _Point | None) -> None:
        self._turn, self._pending, self._ready, self._steps, self._asked_s = turn, None, [], FIRST, None

    def _id(self, qpos: Array) -> str:
        trajectory = Trajectory(qpos, FPS, self.rig.name, self.rig.joint_names())
        return report_id(trajectory, self.rig, self.mount)
