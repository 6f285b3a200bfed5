"""An emulated PWM board with hobby servos: it knows the pulses that it makes, and nothing of what they do."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from drivers.calibration import Calibration, load_calibration
from drivers.emulation.listeners import Event
from drivers.motor import Demand, Motor
from drivers.servos.pwm import Maestro, crc7
from drivers.servos.pwm_bus import BOARDS
from retarget.rig import FULL_TORQUE_ERROR, Rig
from retarget.servos import ServoModel

if TYPE_CHECKING:
    from drivers.emulation.body import Body

BITS_PER_BYTE = 10
EVENTS_KEPT = 200_000
SSC_REPLY_S = 1e-4  # "typically within 100 µs"
ARGUMENTS = {0x84: 3, 0x87: 3, 0x89: 3, 0x90: 1, 0x93: 0, 0xA1: 0, 0xA2: 0}  # data bytes of Maestro commands
PROTOCOL_ERROR, CRC_ERROR = 1 << 4, 1 << 3


class PulseServo:
    """A hobby servo: it follows its pulse where there is one, and is limp where there is none."""

    def __init__(self, made: ServoModel, us: float, now: float) -> None:
        self._radians = 2 * math.pi / made.ticks_per_turn
        self.motor = Motor(made.no_load_speed, FULL_TORQUE_ERROR, us * self._radians)
        self.pulse, self.now = 0, now
        self.load: Callable[[float], None] | None = None

    def get(self, name: str) -> int:
        """`torque_enable`, `goal_position` (the pulse) or `present_position`, both µs."""
        if name == "torque_enable":
            return int(self.pulse > 0)
        return self.pulse if name == "goal_position" else round(self.motor.angle / self._radians)

    def advance(self, now: float) -> None:
        """Bring the motor to `now`."""
        dt, self.now = max(0.0, now - self.now), max(now, self.now)
        if self.load is not None:
            self.load(now)
        else:
            self.motor.advance(dt, self.demand().goal, math.inf)

    def demand(self) -> Demand:
        """What its pulse tells its motor to do."""
        return Demand(self.pulse * self._radians if self.pulse else None, math.inf)


class EmulatedBoard:
    """The Maestro or SSC-32U of `rig`; arguments as of `EmulatedBus`. With `crc` a Maestro wants one each time."""

    def __init__(
        self,
        rig: Rig,
        pose: Sequence[float] | None = None,
        calibration: Calibration | None = None,
        now: float = 0.0,
        body: Body | None = None,
        *,
        device: int = 12,
        crc: bool = False,
    ) -> None:
        angles = dict(zip(rig.joint_names(), rig.pose_vector(rig.nominal) if pose is None else pose, strict=True))
        ticks = (calibration or load_calibration(rig)).ticks([angles[s.joint] for s in rig.servos]).tolist()
        self.servos = {s.id: PulseServo(s.model, t, now) for s, t in zip(rig.servos, ticks, strict=True)}
        if body is not None:
            body.load({s.joint: self.servos[s.id] for s in rig.servos}, now)
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._baud, self._maestro = rig.buses[0].baud, isinstance(BOARDS[rig.buses[0].protocol], Maestro)
        self._device, self._crc = device, crc
        self._buffer = b""
        self._errors = 0

    def exchange(self, data: bytes, now: float, host_baud: int) -> list[tuple[float, bytes]]:
        """What the board answers to `data` that arrived at `now`: (seconds after `now`, bytes), in order."""
        if host_baud != self._baud:
            return []
        for servo in self.servos.values():
            servo.advance(now)
        self._buffer += data
        after, byte_s = len(data) * BITS_PER_BYTE / host_baud, BITS_PER_BYTE / host_baud
        out = []
        for reply in self._maestro_answers(now) if self._maestro else self._ssc_answers(now):
            after += len(reply) * byte_s + (0 if self._maestro else SSC_REPLY_S)
            out.append((after, reply))
        return out

    def brown_out(self, now: float) -> None:
        """A dip of the supply: no pulses until they are set anew."""
        for channel in self.servos:
            self._set(channel, 0, now)

    def _set(self, channel: int, us: int, now: float) -> None:
        if channel in self.servos:
            self.servos[channel].pulse = us
            self.events.append(Event(now, channel, "goal_position", us))

    def _maestro_answers(self, now: float) -> Iterator[bytes]:
        while self._buffer:
            head = 3 if self._buffer[0] == 0xAA else 1
            if len(self._buffer) < head:
                return
            code = self._buffer[head - 1] | 0x80
            size = head + ARGUMENTS.get(code, -head) + self._crc
            if self._buffer[0] < 0x80 or code not in ARGUMENTS:
                self._errors |= PROTOCOL_ERROR
                self._buffer = self._buffer[1:]
                continue
            if len(self._buffer) < size:
                return
            packet, self._buffer = self._buffer[:size], self._buffer[size:]
            if any(byte & 0x80 for byte in packet[1:]):
                self._errors |= PROTOCOL_ERROR
            elif self._crc and crc7(packet[:-1]) != packet[-1]:
                self._errors |= CRC_ERROR
            elif head == 1 or packet[1] == self._device:
                yield from self._command(code, packet[head : size - self._crc], now)

    def _command(self, code: int, data: bytes, now: float) -> Iterator[bytes]:
        if code == 0x84:
            self._set(data[0], (data[1] | data[2] << 7) // 4, now)
        elif code == 0x90:
            pulse = self.servos[data[0]].pulse if data[0] in self.servos else 0
            yield (4 * pulse).to_bytes(2, "little")
        elif code == 0x93:
            yield b"\0"
        elif code == 0xA1:
            errors, self._errors = self._errors, 0
            yield errors.to_bytes(2, "little")
        elif code == 0xA2:
            self.brown_out(now)  # Home is "off" as the channels come from the factory.

    def _ssc_answers(self, now: float) -> Iterator[bytes]:
        *lines, self._buffer = self._buffer.split(b"\r")
        for line in lines:
            text = line.decode("ascii", "replace").replace(" ", "").upper()
            for channel in re.findall(r"QP(\d+)", text):
                servo = self.servos.get(int(channel))
                yield bytes([min(255, servo.pulse // 10) if servo else 0])
            if re.fullmatch(r"(#\d+P\d+(S\d+)?)+(T\d+)?", text):
                for channel, us in re.findall(r"#(\d+)P(\d+)", text):
                    if 500 <= int(us) <= 2500:
                        self._set(int(channel), int(us), now)
            elif re.fullmatch(r"(#\d+[HL])+", text):
                for channel in re.findall(r"#(\d+)[HL]", text):
                    self._set(int(channel), 0, now)
            elif text == "VER":
                yield b"SSC32-V2.50USB\r"
            elif text == "Q":
                yield b"."
