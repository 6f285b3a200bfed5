"""The wire of the emulated bus: instruction packets in, status packets out, each with the time it takes."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from drivers.bus import BusError
from drivers.calibration import Calibration, load_calibration
from drivers.emulated_servo import EmulatedServo
from drivers.packet import BROADCAST, HEADER, Fault, Instruction, Packet, Parser, crc16, status
from drivers.registers import BAUD_CODES, MODELS, TABLE_SIZE
from retarget.rig import Rig

RETURN_DELAY_S = 2e-6  # one unit of register 9
BITS_PER_BYTE = 10  # start, eight, stop
EVENTS_KEPT = 200_000


@dataclass(frozen=True)
class Event:
    """A register write that a servo took: at `time` s (CLOCK_MONOTONIC), servo `id` set `name` to `value`."""

    time: float
    id: int
    name: str
    value: int


class EmulatedBus:
    """The servos of `rig` on one wire, standing at `pose` (nj,) rad, by default the rig's nominal pose.

    `servos`: by id as built; a servo answers to its id register. `events`: the last writes that were taken.
    Raises BusError where the rig has no servos, or one of a model that is not emulated, or a baud rate of no code.
    """

    def __init__(self, rig: Rig, pose: Sequence[float] | None = None, calibration: Calibration | None = None) -> None:
        if not rig.servos:
            raise BusError(f"rig {rig.name!r} has no servos to emulate")
        if unknown := [s.model.name for s in rig.servos if s.model.name not in MODELS]:
            raise BusError(f"servo model {unknown[0]!r} is not emulated; these are: {', '.join(MODELS)}")
        rates = {b.name: b.baud for b in rig.buses}
        if odd := [b.baud for b in rig.buses if b.baud not in BAUD_CODES]:
            raise BusError(f"no Dynamixel X runs at {odd[0]} baud; it may be {', '.join(map(str, BAUD_CODES))}")
        angles = dict(zip(rig.joint_names(), rig.pose_vector(rig.nominal) if pose is None else pose, strict=True))
        calibration = calibration or load_calibration(rig)
        ticks = calibration.ticks([angles[s.joint] for s in rig.servos])
        now = time.monotonic()
        self.servos = {
            s.id: EmulatedServo(s.model, s.id, BAUD_CODES[rates[s.bus]], float(t), now)
            for s, t in zip(rig.servos, ticks, strict=True)
        }
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._parser = Parser()

    def exchange(self, data: bytes, now: float, host_baud: int) -> list[tuple[float, bytes]]:
        """What the bus answers to `data` that arrived at `now`: (seconds after `now`, bytes), in order."""
        replies: list[tuple[float, bytes]] = []
        hearing = {s.get("id"): s for s in self.servos.values() if _RATES[s.get("baud_rate")] == host_baud}
        for packet in self._parser.feed(data):
            byte_s = BITS_PER_BYTE / host_baud
            after = (len(packet.params) + 10) * byte_s
            for servo in hearing.values():
                servo.feed(now)
            for delay_units, reply in self._answers(packet, hearing, now):
                after += delay_units * RETURN_DELAY_S + len(reply) * byte_s
                replies.append((after, reply))
        return replies

    def _answers(self, packet: Packet, hearing: Hearing, now: float) -> Iterator[tuple[int, bytes]]:
        """Carry out `packet`; yields each status packet with its servo's return delay, in units of register 9."""
        kind, params = packet.instruction, packet.params
        if kind == Instruction.SYNC_WRITE and len(params) >= 4:
            address, size = _pair(params, 0)
            for at in range(4, len(params) - size, 1 + size):
                self._write(hearing.get(params[at]), address, params[at + 1 : at + 1 + size], now)
        elif kind == Instruction.BULK_WRITE:
            at = 0
            while at + 5 <= len(params):
                address, size = _pair(params, at + 1)
                self._write(hearing.get(params[at]), address, params[at + 5 : at + 5 + size], now)
                at += 5 + size
        elif kind == Instruction.SYNC_READ and len(params) >= 4:
            address, size = _pair(params, 0)
            for ident in params[4:]:
                yield from _read(hearing.get(ident), ident, address, size)
        elif kind == Instruction.BULK_READ:
            for at in range(0, len(params) - 4, 5):
                yield from _read(hearing.get(params[at]), params[at], *_pair(params, at + 1))
        elif kind == Instruction.FAST_SYNC_READ and len(params) >= 4:
            yield from _fast_read(hearing, params)
        elif packet.id == BROADCAST:
            for ident, servo in sorted(hearing.items()):
                reply = self._single(servo, ident, packet, now)
                if kind == Instruction.PING:
                    yield servo.get("return_delay_time"), reply
        elif packet.id in hearing:
            servo = hearing[packet.id]
            level, delay = servo.get("status_return_level"), servo.get("return_delay_time")
            reply = self._single(servo, packet.id, packet, now)
            if kind == Instruction.PING or level == 2 or (level == 1 and kind == Instruction.READ):
                yield delay, reply

    def _single(self, servo: EmulatedServo, ident: int, packet: Packet, now: float) -> bytes:
        """Carry out an instruction for one servo; returns its status packet."""
        kind, params = packet.instruction, packet.params
        fault, data = Fault.NONE, b""
        if kind == Instruction.PING:
            data = servo.get("model_number").to_bytes(2, "little") + bytes([servo.get("firmware_version")])
        elif kind == Instruction.READ and len(params) == 4:
            answer = servo.read(*_pair(params, 0))
            fault, data = (answer, b"") if isinstance(answer, Fault) else (fault, answer)
        elif kind == Instruction.WRITE and len(params) > 2:
            fault = self._write(servo, _pair(params + b"\0\0", 0)[0], params[2:], now)
        elif kind == Instruction.REG_WRITE and len(params) > 2:
            servo.pending = (_pair(params + b"\0\0", 0)[0], params[2:])
            servo.put("registered_instruction", 1)
        elif kind == Instruction.ACTION:
            if servo.pending is None:
                fault = Fault.RESULT
            else:
                fault = self._write(servo, *servo.pending, now)
                servo.pending = None
                servo.put("registered_instruction", 0)
        elif kind == Instruction.REBOOT:
            servo.reboot(now)
        else:
            fault = Fault.INSTRUCTION
        return status(ident, fault | servo.alert, data)

    def _write(self, servo: EmulatedServo | None, address: int, data: bytes, now: float) -> Fault:
        if servo is None:
            return Fault.NONE
        ident = servo.get("id")
        fault = servo.write(address, data)
        if not fault:
            self.events.extend(Event(now, ident, r.name, servo.get(r.name)) for r in servo.covered(address, len(data)))
        return fault


def _pair(params: bytes, at: int) -> tuple[int, int]:
    """Address and size, two little-endian words."""
    return int.from_bytes(params[at : at + 2], "little"), int.from_bytes(params[at + 2 : at + 4], "little")


def _read(servo: EmulatedServo | None, ident: int, address: int, size: int) -> Iterator[tuple[int, bytes]]:
    if servo is not None and servo.get("status_return_level") > 0:
        answer = servo.read(address, size)
        fault, data = (answer, b"") if isinstance(answer, Fault) else (Fault.NONE, answer)
        yield servo.get("return_delay_time"), status(ident, fault | servo.alert, data)


def _fast_read(hearing: Hearing, params: bytes) -> Iterator[tuple[int, bytes]]:
    """One status packet that all the servos write together, each continuing the CRC of those before it.

    Its length is announced by the first servo, so there is no byte stuffing. A servo that is missing ends it.
    """
    address, size = _pair(params, 0)
    idents = params[4:]
    if not 0 < size <= TABLE_SIZE:
        return
    packet = HEADER + bytes([BROADCAST]) + (1 + len(idents) * (size + 4)).to_bytes(2, "little")
    packet += bytes([Instruction.STATUS])
    delay = 0
    for ident in idents:
        servo = hearing.get(ident)
        answer = Fault.LENGTH if servo is None else servo.read(address, size)
        if servo is None or isinstance(answer, Fault):
            break
        packet += bytes([servo.alert, ident]) + answer
        packet += crc16(packet).to_bytes(2, "little")
        delay = delay or servo.get("return_delay_time")
    yield delay, packet


Hearing = dict[int, EmulatedServo]
_RATES = {code: rate for rate, code in BAUD_CODES.items()}
