"""Control tables of the Dynamixel X series as data: the driver reads and writes by name, the emulator holds them.

Source: ROBOTIS e-Manual, https://emanual.robotis.com/docs/en/dxl/x/ (xm430-w350, xl430-w250, xl330-m288). Addresses
and sizes agree with the `.model` tables that the vendor's SDK carries.
"""

from __future__ import annotations

import math
from dataclasses import replace

from drivers.servos.dynamixel2 import Dynamixel2, Fault
from drivers.servos.family import Family, Model, Register
from retarget.rig import FULL_TORQUE_ERROR

RAM_START = 64  # Below lies EEPROM, which is writable only while torque is off.
TICK_S = 0.020  # one unit of the bus watchdog
WATCHDOG_TRIPPED = 255
VELOCITY_UNIT = 0.229 * 2 * math.pi / 60  # rad/s
VOLTAGE_UNIT = 0.1  # V
POSITION_MODE = 3
BAUD_CODES = {9600: 0, 57600: 1, 115200: 2, 1000000: 3, 2000000: 4, 3000000: 5, 4000000: 6}
HARDWARE_ERRORS = {0: "input voltage", 2: "overheating", 3: "motor encoder", 4: "electrical shock", 5: "overload"}


_TURN = 4095
_ANY32 = 2**31 - 1

REGISTERS = (
    Register("model_number", 0, 2),
    Register("model_information", 2, 4),
    Register("firmware_version", 6, 1, 45),
    Register("id", 7, 1, 1, 0, 252),
    Register("baud_rate", 8, 1, 1, 0, 6),
    Register("return_delay_time", 9, 1, 250, 0, 254),
    Register("drive_mode", 10, 1, 0, 0, 0),
    Register("operating_mode", 11, 1, POSITION_MODE, POSITION_MODE, 5),
    Register("secondary_id", 12, 1, 255, 0, 255),
    Register("protocol_type", 13, 1, 2, 2, 2),
    Register("homing_offset", 20, 4, 0, -1044479, 1044479, signed=True),
    Register("moving_threshold", 24, 4, 10, 0, 1023),
    Register("temperature_limit", 31, 1, 80, 0, 100),
    Register("max_voltage_limit", 32, 2, 160, 60, 160),
    Register("min_voltage_limit", 34, 2, 60, 60, 160),
    Register("pwm_limit", 36, 2, 885, 0, 885),
    Register("velocity_limit", 44, 4, 330, 0, 1023),
    Register("max_position_limit", 48, 4, _TURN, 0, _TURN),
    Register("min_position_limit", 52, 4, 0, 0, _TURN),
    Register("shutdown", 63, 1, 0b110100, 0, 255),
    Register("torque_enable", 64, 1, 0, 0, 1),
    Register("led", 65, 1, 0, 0, 1),
    Register("status_return_level", 68, 1, 2, 0, 2),
    Register("registered_instruction", 69, 1),
    Register("hardware_error_status", 70, 1),
    Register("velocity_i_gain", 76, 2, 1000, 0, 16383),
    Register("velocity_p_gain", 78, 2, 100, 0, 16383),
    Register("position_d_gain", 80, 2, 0, 0, 16383),
    Register("position_i_gain", 82, 2, 0, 0, 16383),
    Register("position_p_gain", 84, 2, 800, 0, 16383),
    Register("feedforward_2nd_gain", 88, 2, 0, 0, 16383),
    Register("feedforward_1st_gain", 90, 2, 0, 0, 16383),
    Register("bus_watchdog", 98, 1, 0, 0, 127),
    Register("goal_pwm", 100, 2, 885, -885, 885, signed=True),
    Register("goal_velocity", 104, 4, 0, -1023, 1023, signed=True),
    Register("profile_acceleration", 108, 4, 0, 0, 32767),
    Register("profile_velocity", 112, 4, 0, 0, 32767),
    Register("goal_position", 116, 4, 0, -_ANY32, _ANY32, signed=True),
    Register("realtime_tick", 120, 2),
    Register("moving", 122, 1),
    Register("moving_status", 123, 1),
    Register("present_pwm", 124, 2, signed=True),
    Register("present_current", 126, 2, signed=True),
    Register("present_velocity", 128, 4, signed=True),
    Register("present_position", 132, 4, signed=True),
    Register("velocity_trajectory", 136, 4, signed=True),
    Register("position_trajectory", 140, 4, signed=True),
    Register("present_input_voltage", 144, 2),
    Register("present_temperature", 146, 1, 30),
)
CURRENT_REGISTERS = (
    Register("current_limit", 38, 2, 1193, 0, 1193),
    Register("goal_current", 102, 2, 0, -1193, 1193, signed=True),
)
INDIRECT_SLOTS = 28  # XM430 and XL430; where an XL330 has its slots depends on its firmware, so they are not used
INDIRECT_ADDRESS, INDIRECT_DATA = 168, 224
INDIRECT = tuple(
    Register(f"indirect_address_{k + 1}", INDIRECT_ADDRESS + 2 * k, 2, INDIRECT_DATA + k, RAM_START, 251)
    for k in range(INDIRECT_SLOTS)
)
FULL_PWM = 885  # register 36
PWM_PER_TICK = 1 / 128  # per unit of register 84: e-Manual, "Position PID Gain", KP = register / 128


def stiff_gain(error: float, ticks_per_turn: int = 4096) -> int:
    """The position gain with which the controller asks for full PWM at `error` rad, as `full_error` has it."""
    return round(FULL_PWM / PWM_PER_TICK * 2 * math.pi / (ticks_per_turn * error))


def full_error(position_p_gain: int, ticks_per_turn: int = 4096) -> float:
    """Position error in rad at which the controller asks for full PWM."""
    return FULL_PWM / (position_p_gain * PWM_PER_TICK) * 2 * math.pi / ticks_per_turn


STIFF = stiff_gain(FULL_TORQUE_ERROR)  # as stiff as what was checked; servos come from the factory half as stiff


def _model(number: int, position_p_gain: int, current_unit: float, *, has_current: bool, indirect: bool) -> Model:
    gain = {"position_p_gain": position_p_gain}
    registers = (*REGISTERS, *(CURRENT_REGISTERS if has_current else ()), *(INDIRECT if indirect else ()))
    return Model(
        number=number,
        registers=tuple(replace(r, default=gain.get(r.name, r.default)) for r in registers),
        eeprom=range(RAM_START),
        state=("present_current", "present_position", "present_input_voltage", "present_temperature"),
        voltage_unit=VOLTAGE_UNIT,
        full_error=full_error(STIFF),
        errors=HARDWARE_ERRORS,
        current=("present_current", current_unit),
        speed=("profile_velocity", VELOCITY_UNIT),
        setup={"return_delay_time": 0, "operating_mode": POSITION_MODE, "position_p_gain": STIFF},
        error_register="hardware_error_status",
        torque=("goal_pwm", "pwm_limit"),
        indirect=(INDIRECT_ADDRESS, INDIRECT_DATA) if indirect else None,
    )


# XL430 reports load in 0.1 % of its stall, not current: of 1.3 A at stall that is 1.3 mA, an estimate.
X_SERIES = Family(
    name="dynamixel2",
    codec=Dynamixel2(),
    models={
        "XM430-W350": _model(1020, 800, 2.69e-3, has_current=True, indirect=True),
        "XL430-W250": _model(1060, 640, 1.3e-3, has_current=False, indirect=True),
        "XL330-M288": _model(1200, 400, 1.0e-3, has_current=True, indirect=False),
    },
    bauds=BAUD_CODES,
    alerts=Fault.ALERT,
    watchdog_s=(TICK_S, 127),
)
