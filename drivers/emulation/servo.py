"""One emulated servo: the registers of its model, the rules for writing them, and a motor behind them.

Times are seconds of any one clock. Position mode only: the motor always follows the goal position.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from drivers.motor import Demand, Motor
from drivers.servos.dynamixel2 import Fault
from drivers.servos.family import Family, Register
from drivers.servos.x_series import TICK_S, WATCHDOG_TRIPPED
from retarget.servos import ServoModel

GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
LIMITS = {
    "dynamixel2": ("min_position_limit", "max_position_limit"),
    "dynamixel1": ("cw_angle_limit", "ccw_angle_limit"),
    "feetech": ("min_angle_limit", "max_angle_limit"),
}
REFUSING = ("dynamixel2", "dynamixel1")  # The others go to the limit without a word.


class EmulatedServo:
    """A servo of `family`, of the model that `made` names, with `ident` on the bus and its shaft at `ticks`.

    `error` holds the bits that it adds to every reply for as long as its trouble lasts. `load`, where it has one, turns
    its motor until the time that it is given.
    """

    def __init__(self, family: Family, made: ServoModel, ident: int, baud_code: int, ticks: float, now: float) -> None:
        self.family, self.model = family, family.models[made.name]
        self.radians = 2 * math.pi / made.ticks_per_turn
        self._by_address = sorted(self.model.registers, key=lambda r: r.address)
        self._at = {r.address + k: (r, k) for r in self.model.registers for k in range(r.size)}
        last = self._by_address[-1]
        slots = sum(r.name.startswith("indirect_address_") for r in self.model.registers)
        self._end = last.address + last.size + slots  # Indirect data lies right behind the indirect addresses.
        self._values: dict[str, int] = {}
        self._bytes: dict[str, bytes] = {}  # the same as the servo stores it
        self._defaults = {
            "model_number": made.model_number,
            "id": ident,
            "baud_rate": baud_code,
            "present_input_voltage": round(made.voltage / self.model.voltage_unit),
        }
        self._stall = made.stall_current
        self.motor = Motor(made.no_load_speed, self.model.full_error, ticks * self.radians)
        self.load: Callable[[float], None] | None = None
        self.error, self._failed = 0, False
        self.pending: tuple[int, bytes] | None = None
        self.now = self._fed = now
        self._move_speed = math.inf
        self._reset(saved=True)

    def get(self, name: str) -> int:
        """Value of the register `name`."""
        return self._values[name]

    def put(self, name: str, value: int) -> None:
        """Set a register from inside the servo, past all rules; tests heat and starve a servo with it."""
        self._bytes[name] = self.model.by_name[name].encode(value)
        self._values[name] = value

    @property
    def baud_code(self) -> int:
        """The register of that name; 0 where there is one rate only."""
        return self._values.get("baud_rate", 0)

    @property
    def alert(self) -> int:
        """What the error byte of every status packet carries while a hardware error stands."""
        if self.family.name == "dynamixel2":
            return Fault.ALERT if self.get("hardware_error_status") else 0
        return self.error

    def fail(self, cause: str) -> None:
        """Trouble by its name in the model's `errors`: the torque goes off; a servo without errors says nothing."""
        bits = sum(1 << bit for bit, name in self.model.errors.items() if name == cause)
        if self.model.errors and not bits:
            raise ValueError(f"no error {cause!r}; there are {', '.join(self.model.errors.values())}")
        self._failed = True
        self.error |= bits
        if "hardware_error_status" in self.model.by_name:
            self.put("hardware_error_status", self.get("hardware_error_status") | bits)
        if bits & self._values.get("shutdown", bits) or not bits:
            self.put("torque_enable", 0)

    def reboot(self, now: float) -> None:
        """RAM back to its defaults and torque off, as after a command or a dip of the supply."""
        self.advance(now)
        self.pending, self.error, self._failed = None, 0, False
        self._reset(saved=False)
        self.advance(now)

    def feed(self, now: float) -> None:
        """An instruction packet, for whomever, came by: the bus watchdog starts again."""
        self.advance(now)
        self._fed = now

    def advance(self, now: float) -> None:
        """Bring motor, watchdog and present values to `now`."""
        watchdog = self._values.get("bus_watchdog", 0)
        trips_at = self._fed + watchdog * TICK_S
        if watchdog not in (0, WATCHDOG_TRIPPED) and now > trips_at and self.get("torque_enable"):
            self._turn(trips_at)
            self.put("goal_position", self._present())
            self.put("bus_watchdog", WATCHDOG_TRIPPED)
        self._turn(now)
        self._feel()
        self.put("present_position", self._present())
        if self.model.current is not None:
            name, unit = self.model.current
            self.put(name, round(self.motor.effort * self._stall / unit))
        if "present_velocity" in self.model.by_name and self.model.speed is not None:
            self.put("present_velocity", round(self.motor.speed / self.model.speed[1]))
            self.put("moving", int(abs(self.get("present_velocity")) > self.get("moving_threshold")))

    def read(self, address: int, length: int) -> bytes | Fault:
        """`length` bytes from `address`, or why not."""
        if length < 1 or address + length > self._end:
            return Fault.LENGTH
        return bytes(self._byte(a) for a in range(address, address + length))

    def write(self, address: int, data: bytes) -> Fault:
        """Write `data` from `address` on as the servo's rules allow; all of it or nothing."""
        end = address + len(data)
        touched = [r for r in self._by_address if r.address < end and address < r.address + r.size]
        if not data or not touched:
            return Fault.ACCESS
        values = {}
        for register in touched:
            if register.low is None:
                return Fault.ACCESS
            if not (address <= register.address and register.address + register.size <= end):
                return Fault.LENGTH
            value = register.decode(data[register.address - address :][: register.size])
            if fault := self._refuses(register, value):
                return fault
            values[register.name] = value
        for name, value in values.items():
            self.accept(name, value)
        return Fault.NONE

    def covered(self, address: int, length: int) -> list[Register]:
        """The registers within `length` bytes from `address`."""
        return [r for r in self._by_address if address <= r.address and r.address + r.size <= address + length]

    def accept(self, name: str, value: int) -> None:
        """Take a value that is allowed."""
        if name == "goal_position":
            value = self._goal(value)
        if name == "torque_enable" and self._failed:
            value = 0
        self.put(name, value)
        if name == "bus_watchdog":
            self._fed = self.now

    def _goal(self, value: int) -> int:
        """The goal as the servo keeps it, with what else it does on a goal."""
        if self.model.enables and not self._failed:
            self.put("torque_enable", 1)
        if self.family.name == "lx16a":
            ticks, ms = value & 0xFFFF, value >> 16
            distance = abs(ticks * self.radians - self.motor.angle)
            self._move_speed = distance / (ms / 1000) if ms else math.inf
            return min(max(ticks, self.get("angle_limits") & 0xFFFF), self.get("angle_limits") >> 16) | ms << 16
        low, high = (self.get(n) for n in LIMITS[self.family.name])
        return value if self.family.name in REFUSING else min(max(value, low), high)

    def _refuses(self, register: Register, value: int) -> Fault:
        name = register.name
        locked = self.family.name == "dynamixel2" and self.get("torque_enable")
        if locked and register.address in self.model.eeprom:
            return Fault.ACCESS
        if register.low is None or not register.low <= value <= register.high:
            return Fault.RANGE
        if name in GOALS and self._values.get("bus_watchdog") == WATCHDOG_TRIPPED:
            return Fault.RANGE
        if name == "goal_position" and self.family.name in REFUSING and self._values.get("operating_mode", 3) == 3:
            low, high = (self.get(n) for n in LIMITS[self.family.name])
            return Fault.NONE if low <= value <= high else Fault.LIMIT
        if name == "torque_enable" and value and self._values.get("hardware_error_status", 0) & self._shutdown():
            return Fault.RESULT
        return Fault.NONE

    def _shutdown(self) -> int:
        return self._values.get("shutdown", 0xFF)

    def demand(self) -> Demand:
        """What its registers tell its motor to do."""
        share = 1.0
        if self.model.torque is not None:
            limit = self.model.torque[0]
            share = self.get(limit) / self.model.by_name[limit].high
        top = self._move_speed
        if self.model.speed is not None:
            name, unit = self.model.speed
            top = self.get(name) * unit or math.inf
        ticks = self.get("goal_position") & 0xFFFF if self.family.name == "lx16a" else self.get("goal_position")
        goal = (ticks - self._values.get("homing_offset", 0)) * self.radians
        return Demand(goal if self.get("torque_enable") else None, top, share)

    def _turn(self, now: float) -> None:
        dt, self.now = max(0.0, now - self.now), max(now, self.now)
        if self.load is not None:
            self.load(now)
            return
        demand = self.demand()
        self.motor.advance(dt, demand.goal, demand.speed)

    def _feel(self) -> None:
        """What a motor with a load says of its heat and supply; beyond what the servo is set to bear, it lets go."""
        if self.motor.temperature is None or self.motor.voltage is None:
            return
        self.put("present_temperature", round(self.motor.temperature))
        self.put("present_input_voltage", round(self.motor.voltage / self.model.voltage_unit))
        if self._failed:
            return
        if self.get("present_temperature") > self.get("temperature_limit"):
            self.fail("overheating")
        elif self.get("present_input_voltage") < self._least_voltage():
            self.fail("input voltage")

    def _least_voltage(self) -> int:
        if "min_voltage_limit" in self.model.by_name:
            return self.get("min_voltage_limit")
        return self.get("voltage_limits") & 0xFFFF

    def _present(self) -> int:
        return round(self.motor.angle / self.radians) + self._values.get("homing_offset", 0)

    def _byte(self, address: int) -> int:
        """What is at `address`; an indirect data register holds what its address register points at."""
        if address in self._at:
            register, k = self._at[address]
            return self._bytes[register.name][k]
        if self.model.indirect is None:
            return 0
        target = self._values.get(f"indirect_address_{address - self.model.indirect[1] + 1}", address)
        return self._byte(target) if target in self._at else 0

    def _reset(self, *, saved: bool) -> None:
        for register in self.model.registers:
            if saved or register.address not in self.model.eeprom:
                self.put(register.name, self._defaults.get(register.name, register.default))
        self.put("present_position", self._present())
        self.put("goal_position", max(0, self._present()))
