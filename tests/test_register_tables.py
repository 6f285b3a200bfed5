"""Registers against the tables that the makers publish, for makes whose SDK brings none: copied here by hand."""

import pytest

from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.lx16a import REGISTERS

# e-Manual, "AX-12A" and "MX-28(1.0)", 2.2 and 2.3, control table of EEPROM and RAM area: address, size
BOTH = {
    "model_number": (0, 2), "firmware_version": (2, 1), "id": (3, 1), "baud_rate": (4, 1),
    "return_delay_time": (5, 1), "cw_angle_limit": (6, 2), "ccw_angle_limit": (8, 2), "temperature_limit": (11, 1),
    "min_voltage_limit": (12, 1), "max_voltage_limit": (13, 1), "max_torque": (14, 2), "status_return_level": (16, 1),
    "alarm_led": (17, 1), "shutdown": (18, 1), "torque_enable": (24, 1), "led": (25, 1), "goal_position": (30, 2),
    "moving_speed": (32, 2), "torque_limit": (34, 2), "present_position": (36, 2), "present_speed": (38, 2),
    "present_load": (40, 2), "present_input_voltage": (42, 1), "present_temperature": (43, 1),
    "registered_instruction": (44, 1),
    "moving": (46, 1), "lock": (47, 1), "punch": (48, 2),
}  # fmt: skip
AX = {"cw_compliance_margin": (26, 1), "ccw_compliance_margin": (27, 1),
      "cw_compliance_slope": (28, 1), "ccw_compliance_slope": (29, 1)}  # fmt: skip
MX = {"d_gain": (26, 1), "i_gain": (27, 1), "p_gain": (28, 1), "goal_acceleration": (73, 1)}

# LewanSoul "Bus Servo Communication Protocol", table 3: command that writes (or only reads), bytes of parameters
COMMANDS = {
    "goal_position": (1, 4), "id": (13, 1), "angle_offset": (18, 1), "angle_limits": (20, 4), "voltage_limits": (22, 4),
    "temperature_limit": (24, 1), "present_temperature": (26, 1), "present_input_voltage": (27, 2),
    "present_position": (28, 2), "operating_mode": (29, 4), "torque_enable": (31, 1), "led": (33, 1),
    "led_errors": (35, 1),
}  # fmt: skip


@pytest.mark.parametrize(("model", "own"), [("AX-12A", AX), ("MX-28", MX)])
def test_registers_of_protocol_1(model, own):
    table = BOTH | own
    ours = {r.name: (r.address, r.size) for r in AX_MX.models[model].registers}
    assert len(ours) > 20
    assert {name: table.get(name) for name in ours} == ours


def test_commands_of_the_lx16a():
    assert {r.name: (r.address, r.size) for r in REGISTERS} == COMMANDS
