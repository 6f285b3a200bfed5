"""Hobby servos on a PWM board, as joints in radians. They cannot be felt: what is read is what they were told.

Nothing says where such a servo stands. When its pulses begin it runs to them at its own full speed, so a rig begins in
its safe pose, or where the board still holds it.
"""

from __future__ import annotations

import math
from types import TracebackType

import numpy as np

from drivers.bus import Array, BusError, Reading
from drivers.calibration import Calibration, load_calibration
from drivers.servos.port import Port, Wire
from drivers.servos.pwm import Board, Maestro, Ssc32
from retarget.rig import Rig

TRIES, OFF_TRIES = 3, 10
BOARDS: dict[str, Board] = {"maestro": Maestro(), "ssc32": Ssc32()}


class PwmBus:
    """The servos of `rig` on the PWM board at the serial `port`, a servo's id being its channel; a `ServoBus`.

    `board`: by default the one that the rig's bus names. Raises BusError where the rig has no servos, several buses,
    a channel that the board does not have, or limits beyond a servo's pulses.
    """

    def __init__(
        self, rig: Rig, port: str | Wire, *, calibration: Calibration | None = None, board: Board | None = None
    ) -> None:
        if len(rig.buses) != 1 or not rig.servos:
            raise BusError(
                f"rig {rig.name!r} has {len(rig.servos)} servos on {len(rig.buses)} buses; one bus is needed"
            )
        [bus] = rig.buses
        self._board = board or BOARDS[bus.protocol]
        if bus.baud not in self._board.bauds:
            raise BusError(
                f"a {self._board.name} runs at {', '.join(map(str, self._board.bauds))} baud, not {bus.baud}"
            )
        if beyond := [s for s in rig.servos if s.id >= self._board.channels]:
            raise BusError(
                f"servo {beyond[0].id} ({beyond[0].joint}): a {self._board.name} has channels 0…"
                f"{self._board.channels - 1}"
            )
        self.joints = tuple(s.joint for s in rig.servos)
        self._calibration = calibration or load_calibration(rig)
        self._calibration.check_reach(rig)
        self._channels = tuple(s.id for s in rig.servos)
        self._port = Port(port, bus.baud)
        speed = {j.name: j.velocity for j in rig.joints}
        us_per_rad = [s.model.ticks_per_turn / (2 * math.pi) for s in rig.servos]
        self._speeds = {s.id: math.ceil(speed[s.joint] * u) for s, u in zip(rig.servos, us_per_rad, strict=True)}
        names = rig.joint_names()
        self._goal = np.array([rig.pose_vector(rig.safe)[names.index(j)] for j in self.joints])
        self._on = False
        self._turn = 0

    def __enter__(self) -> PwmBus:
        self._port.__enter__()
        try:
            pulses = self._pulses(self._channels)
            if pulses is None:
                raise BusError(f"no {self._board.name} answers on {self._port.path} at {self._port.baud} baud")
            held = np.array(pulses)
            self._goal = np.where(held > 0, self._calibration.angle(held), self._goal)
            self._on = bool((held > 0).any())
            self._check()
        except BaseException:
            self._port.__exit__()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            if self._on:
                self.torque(False)
        finally:
            self._port.__exit__()

    def read(self) -> Reading:
        """Where the servos were told to be; current, temperature and voltage are not measured.

        Raises BusError where the board reports errors, or no longer makes a pulse that it was told to make.
        """
        self._check()
        if self._on and self._board.tells_off:
            self._turn = (self._turn + 1) % len(self._channels)
            channel = self._channels[self._turn]
            if self._pulses((channel,)) in (None, [0]):
                joint = self.joints[self._turn]
                raise BusError(f"servo {channel} ({joint}): no pulse: the {self._board.name} has restarted")
        return Reading(self._goal.copy(), np.zeros(0), np.zeros(0), np.zeros(0))

    def write(self, goal: Array) -> None:
        """Goal angles (n,) in rad, all servos at once."""
        if not self._on:
            raise BusError(f"{self._port.path}: the pulses are off: switch them on before writing goals")
        self._send(goal)

    def leave_out(self, joint: str) -> None:
        """Raises BusError: no servo of a board tells that it has failed, only the board does."""
        raise BusError(f"{self._port.path}: the {self._board.name} drives all servos or none")

    def torque(self, on: bool) -> None:
        """Pulses for where the rig was told to be last, at first its safe pose; or none."""
        if on:
            self._port.send(self._board.limit(self._speeds))
            self._on = True
            self._send(self._goal)
            return
        problem = "they go on"
        for _ in range(OFF_TRIES):
            try:
                self._port.send(self._board.pulses(dict.fromkeys(self._channels, 0), self._speeds))
                left = self._pulses(self._channels, tries=1) if self._board.tells_off else [0]
            except BusError as error:
                problem = str(error)
                continue
            if left is not None and not any(left):
                self._on = False
                return
        raise BusError(f"pulses off is not confirmed, cut the power: {problem}")

    def _send(self, goal: Array) -> None:
        widths = dict(zip(self._channels, self._calibration.ticks(goal).tolist(), strict=True))
        self._port.send(self._board.pulses(widths, self._speeds))
        self._goal = np.asarray(goal, float).copy()

    def _pulses(self, channels: tuple[int, ...], *, tries: int = TRIES) -> list[int] | None:
        question, size = self._board.question(channels)
        for _ in range(tries):
            data = self._port.read_bytes(question, size)
            if len(data) == size:
                return self._board.answer(data)
        return None

    def _check(self) -> None:
        """Raises BusError where the board tells of errors, or does not answer."""
        question, size = self._board.trouble()
        if not size:
            return
        data = self._port.read_bytes(question, size)
        if len(data) != size:
            raise BusError(f"no answer from the {self._board.name} on {self._port.path}")
        if errors := self._board.errors(data):
            raise BusError(f"the {self._board.name} on {self._port.path} reports: {', '.join(errors)}")
