"""The line while it runs: chunks are drawn, retargeted and gated ahead of the playhead, and drawn anew when told so.

Work is done in blocks. Each passes the gate together with a way to rest from its end, so whatever has been admitted can
be played, and then stopped. Where a block fails, the rig takes the way to rest, which has passed already, and begins
again from there.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from motiongen.generator import Familiarity
from motiongen.live.generator import LiveGenerator
from motiongen.live.steering import Steer
from motiongen.motion import Motion, cut
from retarget.rig import Mount, Rig
from retarget.streaming import Progress, advance, open_stream
from retarget.trajectory import Trajectory
from sim.ahead import Gate, Moment, Verdict
from sim.checks import report_id

FPS = 50.0  # frames a second on the wire
BLOCK = 6  # frames of human motion: 0.2 s, after each of which something else can begin
LOOK_AHEAD_S = 0.1  # that retargeting sees of what comes
EACH = 2  # frames that go out of each solution: half the work, and no joint is anywhere else by more than 0.05 rad
LEAD_S = 0.2  # at least, from what is said to the first frame that it can change: what making a block takes
LEAD_SHARE = 1.5  # times what the first block after the last change took
PAST_S = 2.0  # of played frames that are remembered

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Block:
    """Frames `qpos` (n, 7 + nj) from frame `first` on that have passed the gate as `report_id`, showing `text`."""

    first: int
    qpos: Array
    report_id: str
    text: str


@dataclass(frozen=True)
class _Point:
    """Where something else can begin: the number of the next frame, that of the generator's, what stays of each stage.
    `way` (m, 7 + nj): to rest from here, `rested` the moment at its end."""

    frame: int
    drawn: int
    progress: Progress
    moment: Moment
    way: Array
    rested: Moment


@dataclass(frozen=True)
class _Ready:
    """A block before the gate: `progress` and the generator's frame after it; `fresh`: a chunk was drawn for it."""

    qpos: Array
    progress: Progress
    drawn: int
    text: str
    fresh: bool


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
        stream, progress = open_stream(
            rig, generator.skeleton, 30.0, mount=self.mount, fps=FPS, look_ahead=LOOK_AHEAD_S, each=EACH
        )
        self._stream, self._opened = stream, progress
        self._gate = Gate(rig, stream.nominal, FPS, self.mount)
        self._begun = self._gate.begin()
        nothing = np.zeros((0, 7 + len(rig.joints)))
        self._points = [_Point(0, generator.frame, progress, self._begun, nothing, self._begun)]
        self.blocks: list[Block] = []
        self._pending: Motion | None = None  # drawn and not yet retargeted
        self._ready: _Ready | None = None  # the next block, before the gate
        self._second = ThreadPoolExecutor(1, "gate")
        self._took_s = 0.0  # for the last block with a chunk of its own

    @property
    def rest_pose(self) -> Array:
        """(7 + nj,): where it begins, and where every way leads."""
        return self._stream.nominal

    @property
    def frame(self) -> int:
        """Number of the next frame that is to be made."""
        return self._points[-1].frame

    def say(self, text: str, playhead: int, *, seconds: float | None = None) -> Familiarity:
        """Do `text` as soon as that can be after the frame `playhead`; see `LiveGenerator.say`."""
        point = self._point_after(playhead)
        found = self.generator.say(text, point.drawn, seconds=seconds)
        if found.known:
            self._go_back(point)
        return found

    def steer(self, steer: Steer, playhead: int) -> None:
        """Steer from as soon after `playhead` as can be; see `LiveGenerator.steer`."""
        point = self._point_after(playhead)
        self.generator.steer(steer, point.drawn)
        self._go_back(point)

    def rest(self, playhead: int) -> Block:
        """The way to rest, which has passed already, from as soon after `playhead` as can be; then it idles."""
        self._go_back(self._point_after(playhead))
        return self.take_way()

    @property
    def way(self) -> Array:
        """(m, 7 + nj) frames to rest from the end of all that was made; none where it is at rest."""
        return self._points[-1].way

    @property
    def way_id(self) -> str:
        """The report in which the way passed: that of the last block."""
        return self.blocks[-1].report_id

    def make(self) -> Block:
        """The next block that may be played. Where the gate refuses what was drawn, that is the way to rest.

        While the gate looks at it, the block after it is drawn and retargeted: of two cores each has its work. But not
        after one that took long already, as somebody may wait for it.
        """
        point, start = self._points[-1], self._clock()
        ready = self._ready or self._prepared(point.progress, point.drawn)
        judging = self._second.submit(self._judged, point.moment, ready.qpos)
        self._ready = None if ready.fresh else self._prepared(ready.progress, ready.drawn)
        verdict = judging.result()
        self._took_s = self._clock() - start if ready.fresh else self._took_s
        if not verdict.ok:
            self.work.refused += 1
            self.work.why = "; ".join(check.advice for check in verdict.failures)
            return self.take_way()
        block = Block(point.frame, ready.qpos, self._id(np.concatenate([ready.qpos, verdict.way])), ready.text)
        end = point.frame + len(ready.qpos)
        self._add(block, _Point(end, ready.drawn, ready.progress, verdict.after, verdict.way, verdict.rested))
        return block

    def forget(self) -> None:
        """The last block was not played: the rig has taken the way to rest before it, see `take_way`."""
        self._go_back(self._points[-2])

    def _prepared(self, progress: Progress, drawn: int) -> _Ready:
        """The block after `progress`, before the gate; the generator has drawn up to frame `drawn` for it."""
        fresh = self._pending is None and drawn == self.generator.frame
        while True:
            began = self._clock()
            motion = self._pending or self.generator.next_chunk()
            self.work.seconds["generate"] += (drew := self._clock()) - began
            self._pending = cut(motion, BLOCK, len(motion)) if len(motion) > BLOCK else None
            now = cut(motion, 0, min(BLOCK, len(motion)))
            progress, streamed = advance(self._stream, progress, now)
            self.work.seconds["retarget"] += self._clock() - drew
            drawn += len(now)
            if len(streamed.qpos):
                return _Ready(streamed.qpos, progress, drawn, now.labels[0].text, fresh)

    def _judged(self, moment: Moment, qpos: Array) -> Verdict:
        began = self._clock()
        verdict = self._gate.judge(moment, qpos)
        self.work.seconds["gate"] += self._clock() - began
        return verdict

    def take_way(self) -> Block:
        """The way to rest from the end of all that was made; behind it the rig idles, and is steered no more."""
        point = self._points[-1]
        way = point.way if len(point.way) else self._stream.nominal[None]
        self.generator.idle(point.drawn)
        self.generator.steer(Steer(), point.drawn)
        self._pending = self._ready = None
        block = Block(point.frame, way, self.way_id if self.blocks else self._id(way), "rest")
        after = _Point(point.frame + len(way), point.drawn, self._opened, point.rested, way[:0], point.rested)
        self._add(block, after)
        return block

    def _add(self, block: Block, point: _Point) -> None:
        self.blocks.append(block)
        self._points.append(point)
        while self._points[1].frame < point.frame - PAST_S * FPS and len(self._points) > 2:
            self._points.pop(0)
            self.blocks.pop(0)

    def _point_after(self, playhead: int) -> _Point:
        """The first point that is far enough ahead, else the last."""
        wanted = playhead + round(max(LEAD_S, LEAD_SHARE * self._took_s) * FPS)
        return next((p for p in self._points if p.frame >= wanted), self._points[-1])

    def _go_back(self, point: _Point) -> None:
        while self._points[-1] is not point:
            self._points.pop()
            self.blocks.pop()
        self._pending = self._ready = None

    def _id(self, qpos: Array) -> str:
        trajectory = Trajectory(qpos, FPS, self.rig.name, self.rig.joint_names())
        return report_id(trajectory, self.rig, self.mount)
