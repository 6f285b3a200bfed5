"""A trajectory where a receiver would be: `drive` plays it as if it came on the wire, through the same gate."""

from __future__ import annotations

import secrets
from dataclasses import replace

import numpy as np

from drivers.buffer import Buffer
from drivers.frame import Frame, encode
from drivers.gate import Gate
from drivers.messages import OPEN_LOOP, Hello, RigState
from drivers.samples import frames_of, hello_for
from drivers.watchdog import Patience, Watchdog
from retarget.rig import Rig
from retarget.trajectory import Trajectory

NS = 1_000_000_000
THERE = 0.1  # rad: so near its first pose a rig may begin
SETTLE_S = 0.5  # and has come to rest there after so long, as it had before it was checked
BEGIN_S = 5.0  # and begins at the latest; a joint that is far off by then trips


class Played:
    """The frames of `trajectory` for `rig`, due from when the rig has come to its first pose; a `Source` for `drive`.

    `controller` is what the report says must run beside it. Raises StreamError where the trajectory's joints are not
    the rig's. Without a `report_id` no frame passes the gate.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        rig: Rig,
        report_id: str,
        patience: Patience | None = None,
        controller: str = OPEN_LOOP,
    ) -> None:
        self.gate, self.watchdog, self.trouble = Gate(rig.hash), Watchdog(patience), ""
        self.buffer, self.run = Buffer(), secrets.randbits(32)
        self.hello: Hello | None = hello_for(trajectory, rig, report_id, 0, controller)
        self._frames = list(frames_of(trajectory, rig, report_id, secrets.randbits(32), 0))
        self._first = dict(zip(trajectory.joints, trajectory.joint_pos[0], strict=True))
        self._order = [s.joint for s in rig.servos]
        self._seq = 0
        self._asked_ns: int | None = None
        self._there_ns: int | None = None
        self._began_ns: int | None = None

    def poll(self, now_ns: int) -> Frame | None:
        """The frame that is due at `now_ns`: the first until the rig is there, none once all have been."""
        self._asked_ns = now_ns if self._asked_ns is None else self._asked_ns
        rests = self._there_ns is not None and now_ns - self._there_ns > SETTLE_S * NS
        if self._began_ns is None and (rests or now_ns - self._asked_ns > BEGIN_S * NS):
            self._began_ns = now_ns
        began = now_ns if self._began_ns is None else self._began_ns
        k = (now_ns - began) // self._frames[0].period_ns
        if k >= len(self._frames):
            self.watchdog.update(now_ns)
            return None
        due = self._frames[k]
        self._seq += 1
        stamped = replace(due, seq=self._seq, capture_ns=now_ns, due_ns=began + due.due_ns)
        frame = self.gate.check(encode(stamped), now_ns)
        if frame is not None:
            self.watchdog.fresh(frame.state, now_ns)
            self.buffer.put(frame)
        self.watchdog.update(now_ns)
        return frame

    def send_state(self, state: RigState) -> None:
        """The rig tells where it is: from its first pose on the motion runs."""
        if self._there_ns is None and state.mode == "following":
            first = np.array([self._first[j] for j in self._order])
            if np.abs(np.array(state.position) - first).max() < THERE:
                self._there_ns = state.time_ns
