"""Feetech STS and SCS servos: protocol 1.0 frames, sign-and-magnitude numbers; STS adds a sync read.

Sources: Feetech's memory tables (SMS/STS and SCSCL, https://www.feetechrc.com) and the maker's SDK,
https://github.com/ftservo/FTServo_Python. SCS numbers are big-endian.
"""

from __future__ import annotations

import math
from dataclasses import replace

from drivers.servos.dynamixel1 import Dynamixel1
from drivers.servos.family import Family, Model, Register

HARDWARE = 0b101111  # error bits: of the servo, all that there are
ERRORS = {0: "input voltage", 1: "angle sensor", 2: "overheating", 3: "overcurrent", 5: "overload"}

_COMMON = (
    Register("model_number", 3, 2),
    Register("id", 5, 1, 1, 0, 253),
    Register("baud_rate", 6, 1, 0, 0, 7),
    Register("return_delay_time", 7, 1, 0, 0, 254),
    Register("status_return_level", 8, 1, 1, 0, 1),
    Register("temperature_limit", 13, 1, 70, 0, 100),
    Register("max_voltage_limit", 14, 1, 80, 0, 254),
    Register("min_voltage_limit", 15, 1, 40, 0, 254),
    Register("max_torque", 16, 2, 1000, 0, 1000),
    Register("torque_enable", 40, 1, 0, 0, 1),
    Register("goal_time", 44, 2, 0, 0, 32767),
    Register("present_speed", 58, 2, sign_bit=15),
    Register("present_load", 60, 2, sign_bit=10),
    Register("present_input_voltage", 62, 1, 74),
    Register("present_temperature", 63, 1, 30),
    Register("moving", 66, 1),
)
STS = (
    *_COMMON,
    Register("min_angle_limit", 9, 2, 0, 0, 4095),
    Register("max_angle_limit", 11, 2, 4095, 0, 4095),
    Register("p_gain", 21, 1, 32, 0, 254),
    Register("d_gain", 22, 1, 32, 0, 254),
    Register("i_gain", 23, 1, 0, 0, 254),
    Register("position_offset", 31, 2, 0, -2047, 2047, sign_bit=11),
    Register("operating_mode", 33, 1, 0, 0, 3),
    Register("acceleration", 41, 1, 0, 0, 254),
    Register("goal_position", 42, 2, 0, -32766, 32766, sign_bit=15),
    Register("goal_speed", 46, 2, 0, 0, 32766),
    Register("torque_limit", 48, 2, 1000, 0, 1000),
    Register("lock", 55, 1, 1, 0, 1),
    Register("present_position", 56, 2, sign_bit=15),
    Register("hardware_error_status", 65, 1),
    Register("present_current", 69, 2, sign_bit=15),
)
SCS = tuple(
    replace(register, order="big")
    for register in (
        *_COMMON,
        Register("min_angle_limit", 9, 2, 0, 0, 1023),
        Register("max_angle_limit", 11, 2, 1023, 0, 1023),
        Register("goal_position", 42, 2, 0, 0, 1023),
        Register("goal_speed", 46, 2, 0, 0, 32766),
        Register("lock", 48, 1, 1, 0, 1),
        Register("present_position", 56, 2),
        Register("hardware_error_status", 65, 1),
    )
)
_GUARD = ("torque_enable", "goal_speed")

# Full torque at 0.1 rad is an estimate: Feetech publishes no figure for its gains. The maker's tables give the current
# in 6.5 mA, load in 0.1 %; of an SCS0009's stall current, 1 A (an estimate too), that is 1 mA.
FEETECH = Family(
    name="feetech",
    codec=Dynamixel1(),
    models={
        "STS3215": Model(
            number=777,
            registers=STS,
            eeprom=range(40),
            state=("present_position", "present_input_voltage", "present_temperature", "present_current"),
            voltage_unit=0.1,
            full_error=0.1,
            errors=ERRORS,
            current=("present_current", 6.5e-3),
            speed=("goal_speed", 2 * math.pi / 4096),
            slow=(_GUARD,),
            guard=_GUARD,
            setup={"return_delay_time": 0, "operating_mode": 0, "acceleration": 0},
            torque=("torque_limit", "max_torque"),
        ),
        "SCS0009": Model(
            number=1284,
            registers=SCS,
            eeprom=range(40),
            state=("present_position", "present_load", "present_input_voltage", "present_temperature"),
            voltage_unit=0.1,
            full_error=0.1,
            errors=ERRORS,
            current=("present_load", 1e-3),
            speed=("goal_speed", math.radians(300) / 1023),
            slow=(_GUARD,),
            guard=_GUARD,
            setup={"return_delay_time": 0},
            group_read=False,
        ),
    },
    bauds={1_000_000: 0, 500_000: 1, 250_000: 2, 128_000: 3, 115_200: 4, 76_800: 5, 57_600: 6, 38_400: 7},
    alerts=HARDWARE,
)
