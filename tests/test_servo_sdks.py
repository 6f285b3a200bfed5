"""The makers' SDKs, unmodified, on a pty with the emulator behind it. That of protocol 2.0 is in test_emulator.py."""

import pytest
from dynamixel_sdk import COMM_SUCCESS, GroupSyncWrite, PacketHandler, PortHandler
from families import rig_of

from drivers.emulation.emulator import Emulator
from drivers.servos.feetech import SCS, STS


def test_registers_are_those_of_the_feetech_sdk():
    sts = pytest.importorskip("scservo_sdk.sms_sts", reason="ftservo-python-sdk comes with the dev extra")
    scs = pytest.importorskip("scservo_sdk.scscl")
    names = {
        "ID": "id", "BAUD_RATE": "baud_rate", "MIN_ANGLE_LIMIT_L": "min_angle_limit", "OFS_L": "position_offset",
        "MAX_ANGLE_LIMIT_L": "max_angle_limit", "MODE": "operating_mode", "TORQUE_ENABLE": "torque_enable",
        "ACC": "acceleration", "GOAL_POSITION_L": "goal_position", "GOAL_TIME_L": "goal_time", "LOCK": "lock",
        "GOAL_SPEED_L": "goal_speed", "PRESENT_POSITION_L": "present_position", "PRESENT_SPEED_L": "present_speed",
        "PRESENT_LOAD_L": "present_load", "PRESENT_VOLTAGE": "present_input_voltage", "MODEL_L": "model_number",
        "PRESENT_TEMPERATURE": "present_temperature", "MOVING": "moving", "PRESENT_CURRENT_L": "present_current",
    }  # fmt: skip
    for module, prefix, registers in ((sts, "SMS_STS_", STS), (scs, "SCSCL_", SCS)):
        ours = {r.name: r.address for r in registers}
        theirs = {names[n]: getattr(module, prefix + n) for n in names if hasattr(module, prefix + n)}
        shared = set(ours) & set(theirs)
        assert len(shared) > 12
        assert {n: ours[n] for n in shared} == {n: theirs[n] for n in shared}


def test_the_sdk_of_protocol_1_drives_the_emulator(monkeypatch):
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 2000)
    rig = rig_of("dynamixel1")
    models = {"c": "MX-28"}
    sdk, ok = PacketHandler(1.0), COMM_SUCCESS
    with Emulator(rig_of("dynamixel1", models), [0.0] * 3) as emulator:
        port = PortHandler(emulator.port)
        assert port.setBaudRate(1_000_000)
        assert sdk.ping(port, 3) == (12, ok, 0)
        assert sdk.ping(port, 1) == (29, ok, 0)
        assert sdk.read2ByteTxRx(port, 3, 36) == (512, ok, 0)
        assert sdk.write2ByteTxRx(port, 3, 32, 100) == (ok, 0)
        assert sdk.write2ByteTxRx(port, 3, 30, 600) == (ok, 0)
        assert emulator.torque() == {"a": True, "b": False, "c": False}  # A goal switches an AX on.
        assert sdk.write2ByteTxRx(port, 3, 8, 500) == (ok, 0)
        assert sdk.write2ByteTxRx(port, 3, 30, 600) == (ok, 0x02)  # beyond the angle limit
        assert sdk.write1ByteTxRx(port, 3, 36, 1) == (ok, 0x08)
        assert sdk.regWriteTxRx(port, 7, 25, 1, [1]) == (ok, 0)
        assert emulator.get("b", "led") == 0
        assert sdk.action(port, 254) == ok
        sdk.ping(port, 7)
        assert emulator.get("b", "led") == 1
        group = GroupSyncWrite(port, sdk, 25, 1)
        assert group.addParam(3, [1])
        assert group.addParam(1, [1])
        assert group.txPacket() == ok
        assert sdk.read1ByteTxRx(port, 1, 25) == (1, ok, 0)
        assert emulator.get("a", "led") == 1
        emulator.servo("b").fail("overheating")
        assert sdk.read1ByteTxRx(port, 7, 43)[2] == 4
        port.closePort()
    assert rig.servos[0].model.name == "AX-12A"


@pytest.mark.parametrize("kind", ["feetech", "feetech scs"])
def test_the_feetech_sdk_drives_the_emulator(kind, monkeypatch):
    sdk = pytest.importorskip("scservo_sdk", reason="ftservo-python-sdk comes with the dev extra")
    monkeypatch.setattr("scservo_sdk.port_handler.LATENCY_TIMER", 2000)
    with Emulator(rig_of(kind), [0.0] * 3) as emulator:
        port = sdk.PortHandler(emulator.port)
        assert port.setBaudRate(1_000_000)
        sts = kind == "feetech"
        handler = sdk.sms_sts(port) if sts else sdk.scscl(port)
        middle = 2048 if sts else 512
        assert handler.ping(3) == (777 if sts else 1284, 0, 0)
        assert handler.ReadPos(3) == (middle, 0, 0)
        assert handler.write1ByteTxRx(3, 40, 1) == (0, 0)
        move = handler.WritePosEx if sts else handler.WritePos
        assert move(3, middle + 50, 800, 0) == (0, 0)
        assert emulator.get("a", "goal_position") == middle + 50
        stage = handler.SyncWritePosEx if sts else handler.SyncWritePos
        assert stage(3, middle - 20, 800, 0)
        assert stage(7, middle + 20, 800, 0)
        assert handler.groupSyncWrite.txPacket() == 0
        assert handler.ReadPos(1) == (middle, 0, 0)
        assert [emulator.get(j, "goal_position") for j in "ab"] == [middle - 20, middle + 20]
        later = handler.RegWritePosEx if sts else handler.RegWritePos
        assert later(7, middle + 9, 800, 0) == (0, 0)
        assert handler.RegAction() in (None, 0)
        handler.ping(7)
        assert emulator.get("b", "goal_position") == middle + 9
        if sts:
            read = sdk.GroupSyncRead(handler, 56, 8)
            for ident in (7, 1, 3):
                assert read.addParam(ident)
            assert read.txRxPacket() == 0
            assert read.isAvailable(1, 56, 2)[0]
            assert read.getData(1, 56, 2) == middle
            assert read.getData(1, 62, 1) == 74
        port.closePort()
