"""Every make of servo: golden bytes of its protocol, and the driver on an emulated bus of it."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, rig_of

from drivers.bus import BusError
from drivers.calibration import load_calibration
from drivers.emulation.bus import EmulatedBus
from drivers.emulation.in_process import InProcess
from drivers.servos import dynamixel1, lx16a
from drivers.servos.connect import connect
from drivers.servos.family import Register
from drivers.servos.packet_bus import PacketBus
from drivers.servos.pwm import Maestro, Ssc32, crc7
from drivers.servos.pwm_bus import PwmBus
from drivers.servos.summed import SummedParser
from retarget.rig import BUILT_IN, Bus, load_rig
from retarget.servos import BOARDS
from retarget.table import RigError

# --- golden bytes

GOLDEN = {
    # e-Manual, "DYNAMIXEL Protocol 1.0": the examples of ping, read, write and sync write
    "ping": (dynamixel1.FRAME.build(1, 1), "FF FF 01 02 01 FB"),
    "read temperature": (dynamixel1.FRAME.build(1, 2, b"\x2b\x01"), "FF FF 01 04 02 2B 01 CC"),
    "write id": (dynamixel1.FRAME.build(254, 3, b"\x03\x01"), "FF FF FE 04 03 03 01 F6"),
    "sync write": (
        dynamixel1.Dynamixel1().write(
            0x1E,
            [
                (0, bytes.fromhex("10005001")),
                (1, bytes.fromhex("20026003")),
                (2, bytes.fromhex("30007001")),
                (3, bytes.fromhex("20028003")),
            ],
        ),
        "FF FF FE 18 83 1E 04 00 10 00 50 01 01 20 02 60 03 02 30 00 70 01 03 20 02 80 03 12",
    ),
    # LewanSoul protocol: servo 1 to 500 in 1000 ms, servo 1 unloaded
    "lx move": (lx16a.FRAME.build(1, 1, (500 | 1000 << 16).to_bytes(4, "little")), "55 55 01 07 01 F4 01 E8 03 16"),
    "lx unload": (lx16a.Lx16a().write(31, [(1, b"\0")]), "55 55 01 04 1F 00 DB"),
    # Maestro User's Guide, 5.c and 5.e: 1500 µs on channels 0 and 2
    "maestro compact": (Maestro().pulses({2: 1500}, {}), "84 02 70 2E"),
    "maestro pololu": (Maestro(12).pulses({0: 1500}, {}), "AA 0C 04 00 70 2E"),
    "maestro speed": (Maestro().limit({5: 3500}), "87 05 0C 01"),
    "maestro errors": (Maestro().trouble()[0], "A1"),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_bytes(name):
    ours, published = GOLDEN[name]
    assert ours == bytes.fromhex(published)


def test_the_crc_of_the_maestro_is_the_one_of_its_guide():
    assert crc7(bytes([0x83, 0x01])) == 0x17
    assert Maestro(crc=True).command(0x83, b"\x01") == bytes([0x83, 0x01, 0x17])


def test_lines_of_the_ssc32():
    assert Ssc32().pulses({5: 1600, 10: 750}, {5: 500, 10: 800}) == b"#5P1600S500#10P750S800\r"
    assert Ssc32().pulses({3: 0, 4: 1500}, {3: 1, 4: 9}) == b"#4P1500S9\r#3L\r"
    assert Ssc32().question((0, 9)) == (b"QP0\rQP9\r", 2)
    assert Ssc32().answer(bytes([150])) == [1500]


@pytest.mark.parametrize("frame", [dynamixel1.FRAME, lx16a.FRAME])
def test_frames_are_found_in_any_pieces_and_past_damage(frame):
    good = frame.build(85, 3, b"\xff\xff\x55\x55")
    bad = bytearray(frame.build(1, 3, b"\x1e\x10"))
    bad[5] ^= 4
    for size in (1, 2, 5, 40):
        parser, found, stream = SummedParser(frame), [], b"\xff" + bytes(bad) + good + good
        for at in range(0, len(stream), size):
            found += parser.feed(stream[at : at + size])
        assert [(p.id, p.params) for p in found] == [(85, b"\xff\xff\x55\x55")] * 2
        assert parser.damaged >= 1


# --- the driver, on each


def test_bulk_read_is_for_mx_alone():
    """The SDK (4.1.0) cannot send one: its group class calls its own handler with one argument too many."""
    bus = EmulatedBus(rig_of("dynamixel1", {"c": "MX-28"}), [0.0] * 3)
    asked = dynamixel1.FRAME.build(254, 0x92, bytes([0, 2, 1, 36, 2, 3, 36]))
    [(_, reply)] = bus.exchange(asked, 0.0, 1_000_000)
    assert reply == dynamixel1.FRAME.build(1, 0, (2048).to_bytes(2, "little"))


HALF_DUPLEX = [k for k in FAMILIES if k not in ("maestro", "ssc32")]


@pytest.mark.parametrize(("kind", "echo"), [(k, False) for k in FAMILIES] + [(k, True) for k in HALF_DUPLEX])
def test_the_driver_measures_and_moves(kind, echo):
    rig = rig_of(kind)
    wire = InProcess(rig, echo=echo)
    feels = kind in HALF_DUPLEX
    tick = max(2 * math.pi / s.model.ticks_per_turn for s in rig.servos)
    with connect(rig, wire) as bus:
        start = [0.2, -0.1, 0.0] if feels else [0.1, 0.0, 0.0]  # Those that cannot be felt begin in the safe pose.
        np.testing.assert_allclose(bus.read().position, start, atol=tick)
        assert not any(wire.torque().values())
        bus.torque(True)
        np.testing.assert_allclose(bus.read().position, start, atol=tick)
        for _ in range(60):
            wire.wait(0.02)
            reading = bus.read()
            bus.write(np.array([0.25, -0.05, 0.1]))
        np.testing.assert_allclose(reading.position, [0.25, -0.05, 0.1], atol=1.5 * tick)
        shown = [wire.get(j, "present_position") for j in "abc"]
        middle = [(sum(s.model.ticks) + 1) // 2 for s in rig.servos]
        angles = (np.array(shown) - middle) * [2 * math.pi / s.model.ticks_per_turn for s in rig.servos]
        np.testing.assert_allclose(angles, [0.25, -0.05, 0.1], atol=1.5 * tick)
        assert all(wire.torque().values())
        if feels:
            assert reading.voltage.tolist() == pytest.approx([s.model.voltage for s in rig.servos], abs=0.05)
            assert reading.temperature.tolist() == [30, 30, 30]
        assert len(reading.current) == (3 if kind not in ("lx16a", "maestro", "ssc32") else 0)
    assert not any(wire.torque().values())


@pytest.mark.parametrize("kind", ["dynamixel2", "dynamixel1", "feetech", "feetech scs"])
@pytest.mark.parametrize("way", [-1, 1])
def test_a_stalled_servo_shows_its_current_and_which_way_it_pushes(kind, way):
    rig = rig_of(kind)
    wire = InProcess(rig, [0.0] * 3)
    with connect(rig, wire) as bus:
        bus.torque(True)
        wire.jam("a")
        for _ in range(2):
            wire.wait(0.02)
            bus.write(np.array([way * 1.0, 0.0, 0.0]))
            wire.wait(0.02)
            reading = bus.read()
    stall = rig.servos[0].model.stall_current
    np.testing.assert_allclose(reading.current, [way * stall, 0.0, 0.0], atol=0.007)


@pytest.mark.parametrize(("bit", "value", "raw"), [(15, -5, "05 80"), (10, -1000, "E8 07"), (11, 2047, "FF 07")])
def test_sign_and_magnitude(bit, value, raw):
    register = Register("any", 0, 2, sign_bit=bit)
    assert register.encode(value) == bytes.fromhex(raw)
    assert register.decode(bytes.fromhex(raw)) == value


def test_models_of_one_family_may_share_a_bus():
    rig = rig_of("feetech", {"b": "SCS0009"})
    wire = InProcess(rig)
    with connect(rig, wire) as bus:
        bus.torque(True)
        for _ in range(40):
            wire.wait(0.02)
            reading = bus.read()
            bus.write(np.array([0.1, 0.2, 0.3]))
        np.testing.assert_allclose(reading.position, [0.1, 0.2, 0.3], atol=0.006)


def test_a_maestro_with_a_number_and_a_crc():
    rig = rig_of("maestro")
    wire = InProcess(rig)
    wire.bus = type(wire.bus)(rig, crc=True)
    with PwmBus(rig, wire, board=Maestro(12, crc=True)) as bus:
        bus.torque(True)
        bus.write(np.array([0.2, 0.0, 0.0]))
        assert wire.get("a", "goal_position") == 1500 + round(0.2 * 3467 / (2 * math.pi)) + 2  # middle is 1502
    with pytest.raises(BusError, match="no maestro answers"), PwmBus(rig, wire, board=Maestro(13, crc=True)):
        pass


def test_boards_say_what_is_wrong():
    rig = rig_of("maestro")
    wire = InProcess(rig)
    with connect(rig, wire) as bus:
        wire.exchange(b"\x05\xc5", wire.now(), 115200)
        with pytest.raises(BusError, match=r"maestro on .* reports: serial protocol"):
            bus.read()
    beyond = replace(rig, servos=tuple(replace(s, id=s.id + 20) for s in rig.servos))
    with pytest.raises(BusError, match=r"servo 27 \(b\): a maestro has channels 0…23"):
        connect(beyond, wire)
    with pytest.raises(BusError, match="a maestro runs at 9600"):
        connect(replace(rig, buses=(Bus("main", "maestro", 1200),)), wire)


def test_a_wrong_protocol_is_one_clear_line():
    wire = InProcess(rig_of("dynamixel1"))
    expected = r"no dynamixel2 servo answers on in process at 1000000 baud: .* and protocol"
    with pytest.raises(BusError, match=expected), PacketBus(rig_of("dynamixel2"), wire):
        pass


def test_servos_that_answer_one_by_one_are_read_in_turn():
    rig = rig_of("lx16a")
    wire = InProcess(rig, latency_s=0.016)
    with connect(rig, wire) as bus:
        wire.traffic.clear()
        began = time.monotonic()
        for _ in range(3):
            bus.read()
        positions = [t for t in wire.traffic if t[4] == 28]
        assert [t[2] for t in positions] == [3, 7, 1]  # One each time: there is no time for more.
        assert time.monotonic() - began < 5  # It is the emulated clock that waits.


def test_a_rig_whose_servos_do_not_speak_its_bus_is_one_clear_line(tmp_path):
    text = (BUILT_IN / "puppet" / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(text.replace('protocol = "dynamixel2"', 'protocol = "feetech"'))
    with pytest.raises(RigError, match="model XL430-W250 speaks dynamixel2, bus 'main' feetech"):
        load_rig(tmp_path)


def test_a_hobby_servo_goes_on_either_board(tmp_path):
    text = (
        (BUILT_IN / "puppet" / "rig.toml")
        .read_text()
        .replace("XM430-W350", "HS-645MG")
        .replace("XL430-W250", "HS-645MG")
    )
    for board in BOARDS:
        (tmp_path / "rig.toml").write_text(text.replace('protocol = "dynamixel2"', f'protocol = "{board}"'))
        assert load_rig(tmp_path).servos[0].model.ticks == (553, 2450)


def test_a_joint_that_does_not_fit_about_the_middle_is_laid_in_it():
    rig = load_rig("puppet")
    calibration = load_calibration(rig, BUILT_IN / "none.toml")
    calibration.check_reach(rig)
    zero = dict(zip((s.joint for s in rig.servos), calibration.zero.tolist(), strict=True))
    assert zero["left_elbow"] == 2048
    assert zero["left_shoulder_pitch"] == 2048 - round((3.4 - 1.6) / 2 * 4096 / (2 * math.pi))


@pytest.mark.parametrize(
    ("kind", "register", "most"),
    [("dynamixel2", "goal_pwm", 885), ("dynamixel1", "torque_limit", 1023), ("feetech", "torque_limit", 1000)],
)
def test_torque_rises_in_steps_from_where_the_servo_stands(kind, register, most):
    rig = rig_of(kind)
    wire = InProcess(rig, [0.4, -0.3, 0.2])
    stood = [wire.get(joint, "present_position") for joint in "abc"]
    wire.servo("b").put({"dynamixel2": "pwm_limit"}.get(kind, "max_torque"), 400)  # what its owner allows
    with connect(rig, wire) as bus:
        bus.torque(True)
        for ident, ceiling in ((3, most), (7, 400)):
            steps = [e for e in wire.events(register) if e.id == ident]
            assert [e.value for e in steps] == [round(share * ceiling) for share in (0.25, 0.5, 0.75, 1.0)]
            [on] = [e for e in wire.events("torque_enable") if e.id == ident and e.value]
            goals = [e for e in wire.events("goal_position") if e.id == ident]
            assert steps[0].time <= goals[0].time < on.time
            assert np.diff([e.time for e in steps[1:]]).min() > 0.1
        assert [wire.get(joint, "present_position") for joint in "abc"] == stood
