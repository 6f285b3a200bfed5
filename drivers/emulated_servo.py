"""One emulated Dynamixel X servo: a control table, the rules for writing it, and a motor behind it."""

from __future__ import annotations

import math

from drivers.motor import Motor, full_error
from drivers.packet import Fault
from drivers.registers import (
    CURRENT_REGISTERS,
    MODELS,
    NAMED,
    RAM_START,
    REGISTERS,
    TABLE_SIZE,
    TICK_S,
    VELOCITY_UNIT,
    VOLTAGE_UNIT,
    WATCHDOG_TRIPPED,
    Register,
)
from retarget.rig import ServoModel

GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")


class EmulatedServo:
    """A servo `model` with `ident` on the bus, its shaft at `ticks`; `baud_code` is its register 8.

    Times are seconds of any one clock. Position mode only (3, 4, 5): the motor always follows the goal position.
    """

    def __init__(self, model: ServoModel, ident: int, baud_code: int, ticks: float, now: float) -> None:
        kind = MODELS[model.name]
        self._radians = 2 * math.pi / model.ticks_per_turn
        self._stall_units = model.stall_current / kind.current_unit
        self.registers: tuple[Register, ...] = REGISTERS + (CURRENT_REGISTERS if kind.has_current else ())
        self._table = bytearray(TABLE_SIZE)
        self._defaults = {
            "model_number": model.model_number,
            "id": ident,
            "baud_rate": baud_code,
            "position_p_gain": kind.position_p_gain,
            "present_input_voltage": round(model.voltage / VOLTAGE_UNIT),
        }
        self.motor = Motor(
            model.no_load_speed, full_error(kind.position_p_gain, model.ticks_per_turn), ticks * self._radians
        )
        self._now = self._fed = now
        self.pending: tuple[int, bytes] | None = None
        self._set_defaults(0)

    def get(self, name: str) -> int:
        """Value of the register `name`."""
        register = NAMED[name]
        raw = self._table[register.address : register.address + register.size]
        return int.from_bytes(raw, "little", signed=register.signed)

    def put(self, name: str, value: int) -> None:
        """Set a register from inside the servo, past all rules; tests heat and starve a servo with it."""
        register = NAMED[name]
        raw = value.to_bytes(register.size, "little", signed=register.signed)
        self._table[register.address : register.address + register.size] = raw

    @property
    def alert(self) -> int:
        """What the error byte of every status packet carries while a hardware error stands."""
        return Fault.ALERT if self.get("hardware_error_status") else 0

    def fault(self, bits: int) -> None:
        """A hardware error: those of the shutdown register's bits switch the torque off; only a reboot clears it."""
        self.put("hardware_error_status", self.get("hardware_error_status") | bits)
        if bits & self.get("shutdown"):
            self.put("torque_enable", 0)

    def reboot(self, now: float) -> None:
        """RAM back to its defaults, torque off."""
        self.advance(now)
        self.pending = None
        self._set_defaults(RAM_START)
        self.advance(now)

    def feed(self, now: float) -> None:
        """An instruction packet, for whomever, came by: the bus watchdog starts again."""
        self.advance(now)
        self._fed = now

    def advance(self, now: float) -> None:
        """Bring motor, watchdog and present values to `now`."""
        watchdog = self.get("bus_watchdog")
        trips_at = self._fed + watchdog * TICK_S
        if watchdog not in (0, WATCHDOG_TRIPPED) and now > trips_at and self.get("torque_enable"):
            self._turn(trips_at)
            self.put("goal_position", self._present())
            self.put("bus_watchdog", WATCHDOG_TRIPPED)
        self._turn(now)
        motor = self.motor
        self.put("realtime_tick", int(now * 1000) % 32768)
        self.put("present_position", self._present())
        self.put("present_velocity", round(motor.speed / VELOCITY_UNIT))
        self.put("present_current", round(motor.effort * self._stall_units))
        self.put("moving", int(abs(self.get("present_velocity")) > self.get("moving_threshold")))

    def read(self, address: int, length: int) -> bytes | Fault:
        """`length` bytes from `address`, or why not."""
        if length < 1 or address + length > TABLE_SIZE:
            return Fault.LENGTH
        return bytes(self._table[address : address + length])

    def write(self, address: int, data: bytes) -> Fault:
        """Write `data` from `address` on as the servo's rules allow; all of it or nothing."""
        end = address + len(data)
        touched = [r for r in self.registers if r.address < end and address < r.address + r.size]
        if not data or not touched or end > TABLE_SIZE:
            return Fault.ACCESS
        values = {}
        for register in touched:
            if register.low is None:
                return Fault.ACCESS
            if not (address <= register.address and register.address + register.size <= end):
                return Fault.LENGTH
            if register.address < RAM_START and self.get("torque_enable"):
                return Fault.ACCESS
            raw = data[register.address - address : register.address - address + register.size]
            value = int.from_bytes(raw, "little", signed=register.signed)
            if not register.low <= value <= register.high:
                return Fault.RANGE
            if fault := self._refuses(register.name, value):
                return fault
            values[register.name] = value
        for name, value in values.items():
            self._accept(name, value)
        return Fault.NONE

    def covered(self, address: int, length: int) -> list[Register]:
        """The registers within `length` bytes from `address`."""
        return [r for r in self.registers if address <= r.address and r.address + r.size <= address + length]

    def _refuses(self, name: str, value: int) -> Fault:
        if name in GOALS and self.get("bus_watchdog") == WATCHDOG_TRIPPED:
            return Fault.RANGE
        if name == "goal_position" and self.get("operating_mode") == 3:
            low, high = self.get("min_position_limit"), self.get("max_position_limit")
            return Fault.NONE if low <= value <= high else Fault.LIMIT
        if name == "torque_enable" and value and self.get("hardware_error_status") & self.get("shutdown"):
            return Fault.RESULT
        return Fault.NONE

    def _accept(self, name: str, value: int) -> None:
        self.put(name, value)
        if name == "bus_watchdog":
            self._fed = self._now

    def _turn(self, now: float) -> None:
        dt, self._now = max(0.0, now - self._now), max(now, self._now)
        profile = self.get("profile_velocity") * VELOCITY_UNIT
        goal = (self.get("goal_position") - self.get("homing_offset")) * self._radians
        self.motor.advance(dt, goal if self.get("torque_enable") else None, profile or math.inf)

    def _present(self) -> int:
        return round(self.motor.angle / self._radians) + self.get("homing_offset")

    def _set_defaults(self, start: int) -> None:
        for register in self.registers:
            if register.address >= start:
                self.put(register.name, self._defaults.get(register.name, register.default))
        self.put("present_position", self._present())
        self.put("goal_position", self._present())
