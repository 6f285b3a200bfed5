"""The wire of an emulated bus of packet servos: requests in, answers out, each with the time that it takes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from drivers.calibration import Calibration, load_calibration
from drivers.emulation import protocol2, summed
from drivers.emulation.listeners import Event, Listeners
from drivers.emulation.servo import EmulatedServo
from drivers.servos.family import Packet
from drivers.servos.table import family_of
from retarget.rig import Rig

if TYPE_CHECKING:
    from drivers.emulation.body import Body

RETURN_DELAY_S = 2e-6  # one unit of the return delay register
BITS_PER_BYTE = 10  # start, eight, stop
EVENTS_KEPT = 200_000
PAUSE_S = 0.02  # A packet that stops in the middle for so long is forgotten: an estimate.

Answers = Callable[[Packet, Listeners], Iterator[tuple[int, bytes]]]
ANSWERS: dict[str, Answers] = {
    "dynamixel2": protocol2.answers,
    "dynamixel1": summed.protocol1,
    "feetech": summed.protocol1,
    "lx16a": summed.lewansoul,
}


class EmulatedBus:
    """The servos of `rig` on one wire, standing at `pose` (nj,) rad, by default the rig's nominal pose, at
    the time `now` s.

    `body`: what the servos turn; without one they run free. `servos`: by id as built; a servo answers to its id
    register. `events`: the last writes that were taken. Raises
    BusError where the rig has no servos, or one that is not emulated, or a baud rate that they do not run at.
    """

    def __init__(
        self,
        rig: Rig,
        pose: Sequence[float] | None = None,
        calibration: Calibration | None = None,
        now: float = 0.0,
        body: Body | None = None,
    ) -> None:
        self._family = family = family_of(rig)
        angles = dict(zip(rig.joint_names(), rig.pose_vector(rig.nominal) if pose is None else pose, strict=True))
        calibration = calibration or load_calibration(rig)
        ticks = calibration.ticks([angles[s.joint] for s in rig.servos]).tolist()
        code = family.bauds[rig.buses[0].baud]
        self.servos = {
            s.id: EmulatedServo(family, s.model, s.id, code, t, now) for s, t in zip(rig.servos, ticks, strict=True)
        }
        if body is not None:
            body.load({s.joint: self.servos[s.id] for s in rig.servos}, now)
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._rates = {code: rate for rate, code in family.bauds.items()}
        self._parser, self._last, self._free_at = family.codec.parser(), now, now

    def brown_out(self, now: float) -> None:
        """A dip of the supply: all servos start anew, limp."""
        for servo in self.servos.values():
            servo.reboot(now)

    def exchange(self, data: bytes, now: float, host_baud: int) -> list[tuple[float, bytes]]:
        """What the bus answers to `data` that arrived at `now`: (seconds after `now`, bytes), in order."""
        if now - self._last > PAUSE_S:
            self._parser = self._family.codec.parser()
        self._last = now
        replies: list[tuple[float, bytes]] = []
        byte_s = BITS_PER_BYTE / host_baud
        after = max(0.0, self._free_at - now) + len(data) * byte_s
        hearing = [s for s in self.servos.values() if self._rates.get(s.baud_code) == host_baud]
        for packet in self._parser.feed(data):
            for servo in hearing:
                servo.feed(now)
            for delay_units, reply in ANSWERS[self._family.name](packet, Listeners(hearing, self.events, now)):
                after += delay_units * RETURN_DELAY_S + len(reply) * byte_s
                replies.append((after, reply))
        self._free_at = now + after
        return replies
