"""From a person's poses to frames that passed the gate, while the person moves: retargeted, judged and put ahead of the
playhead block by block.

Each block passes together with a way to rest from its end. Where a block fails, nothing comes any more, or blocks come
too late, the rig takes that way, holds, and begins again from there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from drivers.clock import Ticker
from drivers.inbox import Heard, Inbox
from drivers.people import Steady
from motiongen.motion import Motion, Skeleton, Source
from motiongen.rotation import Array
from motiongen.smpl import SMPL_SKELETON
from retarget.rig import Mount, Rig
from retarget.streaming import Progress, Stream, advance, open_stream
from retarget.trajectory import Trajectory
from rigcast.performers import Telling
from rigcast.service.playlist import Playlist, Row
from sim.ahead import Gate
from sim.checks import report_id

FPS = 50.0  # frames a second on the wire
BLOCK = 10  # frames that are judged at once: 0.2 s
LOOK_AHEAD_S = 0.1  # that retargeting sees of what comes
EACH = 2  # frames of each of its solutions
START = 20  # frames that are there before the first of them goes out: they make up for blocks that come late
SILENT_S = 0.3  # as for a rig: without a good pose for so long, nobody is there any more
NS = 1_000_000_000


class Line:
    """What a rig on a stand is to do next. Raises RigError for the rig's files, ValueError where it is on no stand."""

    def __init__(self, rig: Rig, mount: Mount | None = None) -> None:
        self.rig = rig
        self.mount: Mount = rig.mount if mount is None else mount
        self._stream, self._opened = self._opened_for(SMPL_SKELETON)
        self._progress = self._opened
        self._gate = Gate(rig, self._stream.nominal, FPS, self.mount)
        self._moment = self._rested = self._gate.begin()
        self._way = self.rest_pose[None, :][:0]
        self._way_id = ""

    @property
    def rest_pose(self) -> Array:
        """(7 + nj,): where it begins, and where every way leads."""
        return self._stream.nominal

    @property
    def way(self) -> tuple[Row, ...]:
        """To rest from the end of all that was made; none where it is at rest."""
        return tuple(Row(row, self._way_id, "rest") for row in self._way)

    def begin(self, skeleton: Skeleton) -> None:
        """At rest, with somebody of these proportions."""
        self._stream, self._opened = self._opened_for(skeleton)
        self._progress = self._opened

    def make(self, motion: Motion) -> tuple[list[Row], str]:
        """The frames that `motion` adds (none at first: a few are looked at ahead), and why the gate refuses them, ""
        where they have passed."""
        self._progress, streamed = advance(self._stream, self._progress, motion)
        if not len(streamed.qpos):
            return [], ""
        verdict = self._gate.judge(self._moment, streamed.qpos)
        if not verdict.ok:
            return [], "; ".join(check.advice for check in verdict.failures)
        whole = Trajectory(np.concatenate([streamed.qpos, verdict.way]), FPS, self.rig.name, self.rig.joint_names())
        self._way_id = report_id(whole, self.rig, self.mount)
        self._moment, self._rested, self._way = verdict.after, verdict.rested, verdict.way
        return [Row(row, self._way_id, "mirror") for row in streamed.qpos], ""

    def rest(self) -> None:
        """The rig takes the way to rest; what is made next begins behind it."""
        self._moment, self._way = self._rested, self._way[:0]
        self._progress = self._opened

    def _opened_for(self, skeleton: Skeleton) -> tuple[Stream, Progress]:
        return open_stream(self.rig, skeleton, FPS, mount=self.mount, fps=FPS, look_ahead=LOOK_AHEAD_S, each=EACH)


class Mirror:
    """Keeps `playlist` filled from what `inbox` hears; call `work` over and over, from one thread.

    `tell` is told what there is to know: what it is about, and a line of it. `counts`: poses, blocks that passed and
    that the gate refused, how often blocks came too late, messages that made no sense.
    """

    def __init__(
        self,
        telling: Telling,
        inbox: Inbox,
        line: Line,
        playlist: Playlist,
        source: Source,
        clock: Ticker,
        tell: Callable[[str, str], None],
    ) -> None:
        self._telling, self._inbox, self._line, self._playlist = telling, inbox, line, playlist
        self._source, self._clock, self._tell = source, clock, tell
        self._skeleton = SMPL_SKELETON
        self._steady: Steady | None = None  # while somebody is there
        self._began_ns = self._heard_ns = self._posed_ns = self._from_ns = 0
        self._early: list[Row] = []  # until there are START of them
        self._playing = False
        self.counts: Counter[str] = Counter(poses=0, passed=0, refused=0, late=0, senseless=0)

    def work(self) -> bool:
        """Deal with what has come; whether there was anything to be done."""
        heard = self._inbox.take()
        for each in heard:
            self._hear(each)
        self._look()
        motion = None if self._steady is None else self._steady.take(BLOCK, self._skeleton, self._source)
        if motion is not None:
            self._make(motion)
        return bool(heard) or motion is not None

    def leave(self, *, by_itself: bool = False) -> None:
        """Lead the rig to rest, where it has not gone `by_itself`; whoever is still there is mirrored anew."""
        if self._playing and not by_itself:
            self._playlist.put(list(self._line.way), ())  # not taken where rows have run out just now: by itself, then
        self._playlist.take_ran_out()
        self._line.rest()
        self._steady, self._early, self._playing = None, [], False

    def _look(self) -> None:
        """Whether somebody is there, and who else."""
        now, lacking = self._clock.now_ns(), self._telling.lacking
        if self._playlist.take_ran_out():
            self._ran_out()
        if self._steady is not None and now - self._posed_ns > SILENT_S * NS:
            self._tell("silent", f"no pose for {SILENT_S:g} s; the rig goes to rest and holds")
            self.leave()
        if self._steady is None and lacking and self._heard_ns - self._began_ns > NS > now - self._heard_ns:
            self._tell("lacking", f"there is nobody to mirror: {lacking}")
        if self._inbox.foreigner:
            self._tell("foreign", f"{self._inbox.foreigner} is not heard: it may not speak, or somebody else does")
            self._inbox.foreigner = ""

    def _hear(self, heard: Heard) -> None:
        if heard.at_ns - self._heard_ns > NS:
            self._began_ns = heard.at_ns
        self._heard_ns = heard.at_ns
        try:
            people = self._telling.hear(heard)
            if people and self._steady is None:
                self._begin(heard.sender)
        except ValueError as error:
            self.counts["senseless"] += 1
            self._tell("senseless", str(error))
            return
        self.counts["poses"] += len(people)
        for person in people:
            if self._steady is not None and person.at_ns >= self._from_ns:
                self._posed_ns = heard.at_ns
                self._steady.put(person)

    def _begin(self, sender: str) -> None:
        """Somebody is there. What comes while the rig is made ready is left out: it would be shown late for good."""
        self._skeleton = self._telling.skeleton()
        self._line.begin(self._skeleton)
        self._steady, self._from_ns = Steady(FPS), self._clock.now_ns()
        self._posed_ns = self._from_ns
        self._tell("begun", f"{sender} is mirrored")

    def _make(self, motion: Motion) -> None:
        rows, why = self._line.make(motion)
        if why:
            self.counts["refused"] += 1
            self._tell("refused", f"the gate refuses what is shown; the rig goes to rest: {why}")
            self.leave()
            return
        self.counts["passed"] += bool(rows)
        self._early += rows
        if self._playing or len(self._early) >= START:
            self._playing = True
            if self._playlist.put(self._early, self._line.way):
                self._early = []
            else:
                self._ran_out()

    def _ran_out(self) -> None:
        self.counts["late"] += 1
        self._tell("late", "frames came too late; the rig has gone to rest")
        self.leave(by_itself=True)
