"""Dynamixel X servos through the vendor's SDK, as joints in radians.

The SDK prints instead of raising, says False to a baud rate it does not list, drops the error bytes of a fast sync
read and polls the port without pause; all of that ends here in BusError lines and blocking reads.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Iterator, Sequence
from types import TracebackType

import numpy as np
from dynamixel_sdk import COMM_SUCCESS, GroupSyncWrite, PortHandler, Protocol2PacketHandler

from drivers.bus import Array, BusError, Reading
from drivers.calibration import Calibration, load_calibration
from drivers.packet import Fault
from drivers.registers import (
    BAUD_CODES,
    MODELS,
    NAMED,
    POSITION_MODE,
    TICK_S,
    VELOCITY_UNIT,
    VOLTAGE_UNIT,
    hardware_errors,
)
from retarget.rig import Rig

try:
    import termios

    PORT_ERRORS: tuple[type[Exception], ...] = (OSError, termios.error)  # pyserial lets both through
except ImportError:  # Windows
    PORT_ERRORS = (OSError,)

TRIES = 3
READ_WAIT_S = 0.005  # The SDK asks again until its own timeout; waiting in the kernel leaves it the processor.
FIRST, LAST = NAMED["present_current"], NAMED["present_temperature"]
BLOCK = LAST.address + LAST.size - FIRST.address


class DynamixelBus:
    """The servos of `rig` at the serial `port`; a `ServoBus`.

    `watchdog_s`: where nothing has come over the wire for so long, the servos themselves stop and hold (they keep
    torque). `calibration`: of this unit, by default the user's file. Raises BusError where the rig has no servos,
    several buses, or servos of another make.
    """

    def __init__(self, rig: Rig, port: str, *, calibration: Calibration | None = None, watchdog_s: float = 0.5) -> None:
        if len(rig.buses) != 1 or not rig.servos:
            raise BusError(
                f"rig {rig.name!r} has {len(rig.servos)} servos on {len(rig.buses)} buses; one bus is needed"
            )
        if foreign := [s.model.name for s in rig.servos if s.model.name not in MODELS]:
            raise BusError(f"servo model {foreign[0]!r} is no Dynamixel X that is known here: {', '.join(MODELS)}")
        if not TICK_S <= watchdog_s <= 127 * TICK_S:
            raise BusError(f"watchdog_s {watchdog_s}; a servo's bus watchdog takes {TICK_S}…{127 * TICK_S:.2f} s")
        self.joints = tuple(s.joint for s in rig.servos)
        self._port = port
        self._baud = rig.buses[0].baud
        self._servos = {s.id: s for s in rig.servos}
        self._ids = list(self._servos)
        self._calibration = calibration or load_calibration(rig)
        self._watchdog_units = math.ceil(watchdog_s / TICK_S)
        speed = {j.name: j.velocity for j in rig.joints}
        self._profile = [math.ceil(speed[j] / VELOCITY_UNIT) for j in self.joints]
        self._current_unit = np.array([MODELS[s.model.name].current_unit for s in rig.servos])
        self._handler = Protocol2PacketHandler()
        self._handle: PortHandler | None = None
        self._may_be_on = False
        self._fast_failures = 0
        self._last_sent = 0.0
        self._silence_s = 0.0  # the longest since the torque came on

    def __enter__(self) -> DynamixelBus:
        handle = PortHandler(self._port)
        try:
            listed = handle.setBaudRate(self._baud)
        except PORT_ERRORS as error:
            raise BusError(f"cannot open serial port {self._port!r}: {_text(error)}") from None
        if not listed:
            raise BusError(f"the SDK knows no {self._baud} baud; Dynamixel X run at {', '.join(map(str, BAUD_CODES))}")
        handle.ser.timeout = READ_WAIT_S
        self._handle = handle
        try:
            self._check_models()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            if self._may_be_on:
                self.torque(False)
        finally:
            self._close()

    def read(self) -> Reading:
        """Measure all servos in one exchange; where a fast sync read fails an ordinary one is tried."""
        rows = np.frombuffer(b"".join(self._read_block()), _BLOCK)
        return Reading(
            position=self._calibration.angle(rows["position"]),
            current=rows["current"] * self._current_unit * self._calibration.direction,
            temperature=rows["temperature"].astype(float),
            voltage=rows["voltage"] * VOLTAGE_UNIT,
        )

    def write(self, goal: Array) -> None:
        """Goal angles (n,) in rad, all servos at once.

        Raises BusError too where the bus was silent for longer than the servos' watchdog waits: they have stopped, and
        take no goal until the torque is switched on anew.
        """
        self._note_silence()
        if self._may_be_on and self._silence_s > self._watchdog_units * TICK_S:
            raise BusError(f"{self._port}: nothing was sent for {self._silence_s:.2f} s: the servos stopped themselves")
        self._sync_write("goal_position", self._calibration.ticks(goal).tolist())

    def torque(self, on: bool) -> None:
        """All on, holding the pose that they are in, with the servos' watchdog armed; or all off, confirmed by each.

        Raises BusError naming the joints of servos with a hardware error or that did not do it.
        """
        if on:
            self._torque_on()
        else:
            self._torque_off()

    def _torque_on(self) -> None:
        for ident, bits in zip(self._ids, self._sync_read("hardware_error_status"), strict=True):
            if bits:
                raise BusError(f"{self._name(ident)}: {hardware_errors(bits)}; remove the cause, then power it anew")
        if any(self._sync_read("torque_enable")):
            self._torque_off()
        if set(self._sync_read("operating_mode")) != {POSITION_MODE}:
            self._sync_write("operating_mode", [POSITION_MODE] * len(self._ids))
        self._sync_write("bus_watchdog", [0] * len(self._ids))
        self._sync_write("profile_velocity", self._profile)
        here = self._sync_read("present_position")
        self._sync_write("goal_position", here)
        for ident, at, goal in zip(self._ids, here, self._sync_read("goal_position"), strict=True):
            if at != goal:
                raise BusError(
                    f"{self._name(ident)}: stands at {at} ticks, outside the limits that the servo is set to"
                )
        self._may_be_on = True
        self._sync_write("torque_enable", [1] * len(self._ids))
        off = [i for i, on in zip(self._ids, self._sync_read("torque_enable"), strict=True) if not on]
        if off:
            raise BusError(f"{self._name(off[0])}: does not switch its torque on")
        self._sync_write("bus_watchdog", [self._watchdog_units] * len(self._ids))
        self._silence_s = 0.0

    def _torque_off(self) -> None:
        problem = ""
        for _ in range(TRIES):
            try:
                self._sync_write("torque_enable", [0] * len(self._ids))
                on = [i for i, on in zip(self._ids, self._sync_read("torque_enable"), strict=True) if on]
            except BusError as error:
                problem = str(error)
                continue
            if not on:
                self._may_be_on = False
                return
            problem = f"{self._name(on[0])}: keeps its torque on"
        raise BusError(f"torque off is not confirmed, cut the power: {problem}")

    def _check_models(self) -> None:
        missing = []
        for ident, servo in self._servos.items():
            for _ in range(TRIES):
                with self._lost_port():
                    found, result, _ = self._handler.ping(self._port_handle(), ident)
                if result == COMM_SUCCESS:
                    break
            if result != COMM_SUCCESS:
                missing.append(self._name(ident))
            elif found != servo.model.model_number:
                model = servo.model
                raise BusError(f"{self._name(ident)}: model {found}; the rig names {model.name}, {model.model_number}")
        if len(missing) == len(self._ids):
            raise BusError(f"no servo answers on {self._port} at {self._baud} baud: check power, cable and baud rate")
        if missing:
            raise BusError(f"no answer on {self._port} from {', '.join(missing)}")

    def _read_block(self) -> list[bytes]:
        """Registers 126 … 146 of every servo."""
        if self._fast_failures < TRIES:
            rows = self._fast_read()
            if rows is not None:
                self._fast_failures = 0
                return rows
            self._fast_failures += 1
        return self._plain_read(FIRST.address, BLOCK)

    def _fast_read(self) -> list[bytes] | None:
        with self._lost_port():
            handle, count = self._port_handle(), len(self._ids)
            result = self._handler.syncReadTx(handle, FIRST.address, BLOCK, self._ids, count, True)
            raw, result = self._handler.rxPacket(handle, True) if result == COMM_SUCCESS else ([], result)
        parts = [raw[at : at + BLOCK + 4] for at in range(8, len(raw) - 2, BLOCK + 4)]
        if result != COMM_SUCCESS or [p[1] for p in parts] != self._ids:
            return None
        for ident, part in zip(self._ids, parts, strict=True):
            self._check_alert(ident, part[0])
        return [bytes(p[2 : 2 + BLOCK]) for p in parts]

    def _plain_read(self, address: int, size: int) -> list[bytes]:
        silent: list[str] = []
        for _ in range(TRIES):
            rows, silent = [], []
            with self._lost_port():
                handle = self._port_handle()
                self._handler.syncReadTx(handle, address, size, self._ids, len(self._ids), False)
                answers = [(i, *self._handler.readRx(handle, i, size)) for i in self._ids]
            for ident, data, result, error in answers:
                if result != COMM_SUCCESS or len(data) != size:
                    silent.append(self._name(ident))
                else:
                    if address > NAMED["hardware_error_status"].address:
                        self._check_alert(ident, error)
                    rows.append(bytes(data))
            if not silent:
                return rows
        raise BusError(f"no answer on {self._port} from {', '.join(silent)}")

    def _sync_read(self, name: str) -> list[int]:
        register = NAMED[name]
        rows = self._plain_read(register.address, register.size)
        return [int.from_bytes(row, "little", signed=register.signed) for row in rows]

    def _sync_write(self, name: str, values: Sequence[int]) -> None:
        register = NAMED[name]
        with self._lost_port():
            group = GroupSyncWrite(self._port_handle(), self._handler, register.address, register.size)
            for ident, value in zip(self._ids, values, strict=True):
                group.addParam(ident, value.to_bytes(register.size, "little", signed=register.signed))
            result = group.txPacket()
        if result != COMM_SUCCESS:
            raise BusError(f"{self._port}: {self._handler.getTxRxResult(result)}")

    def _check_alert(self, ident: int, error: int) -> None:
        if error & Fault.ALERT:
            register = NAMED["hardware_error_status"]
            with self._lost_port():
                data, _, _ = self._handler.readTxRx(self._port_handle(), ident, register.address, register.size)
            raise BusError(f"{self._name(ident)}: hardware error: {hardware_errors(data[0] if data else 0)}")

    def _port_handle(self) -> PortHandler:
        if self._handle is None:
            raise BusError(f"{self._port} is not open: use the bus as a context manager")
        self._note_silence()
        self._handle.is_using = False  # An exception within the SDK would leave its own lock locked.
        return self._handle

    def _note_silence(self) -> None:
        now = time.monotonic()
        self._silence_s, self._last_sent = max(self._silence_s, now - self._last_sent), now

    @contextlib.contextmanager
    def _lost_port(self) -> Iterator[None]:
        try:
            yield
        except PORT_ERRORS as error:
            raise BusError(f"serial port {self._port!r} is lost: {_text(error)}") from None

    def _name(self, ident: int) -> str:
        return f"servo {ident} ({self._servos[ident].joint})"

    def _close(self) -> None:
        if self._handle is not None:
            with contextlib.suppress(*PORT_ERRORS):
                self._handle.closePort()
            self._handle = None


def _text(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else " ".join(str(a) for a in error.args)


_BLOCK = np.dtype(
    {
        "names": ["current", "position", "voltage", "temperature"],
        "formats": ["<i2", "<i4", "<u2", "u1"],
        "offsets": [
            NAMED[name].address - FIRST.address
            for name in ("present_current", "present_position", "present_input_voltage", "present_temperature")
        ],
        "itemsize": BLOCK,
    }
)
