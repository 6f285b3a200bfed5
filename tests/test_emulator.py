"""The emulated bus, driven by the vendor's SDK as it is over a real pty, and its timing in process."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from dynamixel_sdk import (
    COMM_RX_TIMEOUT,
    COMM_SUCCESS,
    GroupBulkRead,
    GroupBulkWrite,
    GroupSyncRead,
    GroupSyncWrite,
    PacketHandler,
    PortHandler,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from small_rig import XM430, small_rig

from drivers.bus import BusError
from drivers.calibration import Calibration
from drivers.emulation.bus import EmulatedBus
from drivers.emulation.emulator import Emulator
from drivers.emulation.servo import EmulatedServo
from drivers.motor import Motor
from drivers.servos.dynamixel2 import Fault, Instruction, Parser, build
from drivers.servos.x_series import X_SERIES, full_error

RIG = small_rig()
CENTRE = Calibration(np.ones(3, np.int64), np.full(3, 2048), np.full(3, 4096))
SDK = PacketHandler(2.0)
TORQUE, GOAL, POSITION, ID, RETURN_DELAY, ERRORS, LED = 64, 116, 132, 7, 9, 70, 65
ACCESS, RANGE, LIMIT, RESULT, ALERT = 7, 4, 6, 1, 0x80


@pytest.fixture
def emulator():
    with Emulator(RIG, [0.0] * 3, CENTRE) as running:
        yield running


@pytest.fixture
def port(emulator, monkeypatch):
    # The SDK waits 2 x 16 ms for a USB adapter's buffer; a busy test machine may hold a thread up for longer.
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 150)
    handle = PortHandler(emulator.port)
    assert handle.openPort()
    assert handle.setBaudRate(1_000_000)
    yield handle
    handle.closePort()


def test_ping(port):
    assert SDK.ping(port, 3) == (1020, COMM_SUCCESS, 0)
    assert SDK.ping(port, 7) == (1060, COMM_SUCCESS, 0)
    assert SDK.ping(port, 4)[1] == COMM_RX_TIMEOUT


def test_broadcast_ping(port):
    assert SDK.broadcastPing(port) == ({1: [1020, 45], 3: [1020, 45], 7: [1060, 45]}, COMM_SUCCESS)


def test_read_and_write(port, emulator):
    assert SDK.read4ByteTxRx(port, 3, POSITION) == (2048, COMM_SUCCESS, 0)
    assert SDK.write1ByteTxRx(port, 3, LED, 1) == (COMM_SUCCESS, 0)
    assert SDK.read1ByteTxRx(port, 3, LED) == (1, COMM_SUCCESS, 0)
    assert emulator.get("a", "led") == 1
    assert SDK.write4ByteTxRx(port, 4, GOAL, 0)[0] == COMM_RX_TIMEOUT


@pytest.mark.parametrize(
    ("address", "value", "error"),
    [
        (POSITION, 1, ACCESS),  # read-only
        (5, 1, ACCESS),  # part of a read-only register
        (60, 1, ACCESS),  # no register there
        (LED, 2, RANGE),
        (11, 1, RANGE),  # velocity mode: not emulated
        (GOAL, 1, 5),  # one byte of four
    ],
)
def test_a_write_that_the_servo_refuses(port, address, value, error):
    assert SDK.write1ByteTxRx(port, 3, address, value) == (COMM_SUCCESS, error)


def test_a_goal_beyond_the_limits_is_refused(port, emulator):
    assert SDK.write4ByteTxRx(port, 3, GOAL, 4096) == (COMM_SUCCESS, LIMIT)
    assert SDK.write4ByteTxRx(port, 3, 52, 1000) == (COMM_SUCCESS, 0)
    assert SDK.write4ByteTxRx(port, 3, GOAL, 999) == (COMM_SUCCESS, LIMIT)
    assert SDK.write4ByteTxRx(port, 3, GOAL, 1000) == (COMM_SUCCESS, 0)
    assert [e.value for e in emulator.events("goal_position")] == [1000]


def test_eeprom_is_locked_while_torque_is_on(port):
    assert SDK.write1ByteTxRx(port, 3, RETURN_DELAY, 0) == (COMM_SUCCESS, 0)
    assert SDK.write1ByteTxRx(port, 3, TORQUE, 1) == (COMM_SUCCESS, 0)
    assert SDK.write1ByteTxRx(port, 3, RETURN_DELAY, 5) == (COMM_SUCCESS, ACCESS)
    assert SDK.read1ByteTxRx(port, 3, RETURN_DELAY)[0] == 0
    assert SDK.write1ByteTxRx(port, 3, LED, 1) == (COMM_SUCCESS, 0)


def test_a_changed_id_answers_to_the_new_one(port):
    assert SDK.write1ByteTxRx(port, 3, ID, 30)[0] == COMM_SUCCESS
    assert SDK.ping(port, 30) == (1020, COMM_SUCCESS, 0)
    assert SDK.ping(port, 3)[1] == COMM_RX_TIMEOUT


def test_another_baud_rate_is_not_heard(port):
    assert port.setBaudRate(57600)
    assert SDK.ping(port, 3)[1] == COMM_RX_TIMEOUT
    assert port.setBaudRate(1_000_000)
    assert SDK.ping(port, 3)[1] == COMM_SUCCESS
    SDK.write1ByteTxRx(port, 3, 8, 1)  # code 1 is 57600
    assert SDK.ping(port, 3)[1] == COMM_RX_TIMEOUT
    assert port.setBaudRate(57600)
    assert SDK.ping(port, 3)[1] == COMM_SUCCESS


def test_sync_write_and_both_sync_reads(port, emulator):
    for ident in (1, 3, 7):
        SDK.write1ByteTxRx(port, ident, TORQUE, 1)
    write = GroupSyncWrite(port, SDK, GOAL, 4)
    for ident, goal in ((1, 2148), (3, 1948), (7, 2098)):
        write.addParam(ident, goal.to_bytes(4, "little"))
    assert write.txPacket() == COMM_SUCCESS
    time.sleep(0.5)
    for fast in (False, True):
        read = GroupSyncRead(port, SDK, POSITION, 4)
        for ident in (7, 1, 3):
            read.addParam(ident)
        assert (read.fastSyncRead() if fast else read.txRxPacket()) == COMM_SUCCESS
        assert [read.getData(i, POSITION, 4) for i in (1, 3, 7)] == [2148, 1948, 2098]
    emulator.remove("c")
    assert read.txRxPacket() == COMM_RX_TIMEOUT


def test_bulk_write_and_read(port):
    write = GroupBulkWrite(port, SDK)
    write.addParam(1, GOAL, 4, (2000).to_bytes(4, "little"))
    write.addParam(7, LED, 1, [1])
    assert write.txPacket() == COMM_SUCCESS
    read = GroupBulkRead(port, SDK)
    read.addParam(1, GOAL, 4)
    read.addParam(7, LED, 1)
    assert read.txRxPacket() == COMM_SUCCESS
    assert (read.getData(1, GOAL, 4), read.getData(7, LED, 1)) == (2000, 1)


def test_registered_write_waits_for_the_action(port, emulator):
    SDK.regWriteTxRx(port, 3, LED, 1, [1])
    assert emulator.get("a", "led") == 0
    assert SDK.action(port, 254) == COMM_SUCCESS
    assert SDK.read1ByteTxRx(port, 3, LED)[0] == 1


def test_an_unknown_instruction_is_named(port):
    assert SDK.factoryReset(port, 3, 0xFF) == (COMM_SUCCESS, 2)


def test_status_return_level(port):
    SDK.write1ByteTxRx(port, 3, 68, 1)
    assert SDK.write1ByteTxRx(port, 3, LED, 1)[0] == COMM_RX_TIMEOUT
    assert SDK.read1ByteTxRx(port, 3, LED) == (1, COMM_SUCCESS, 0)
    SDK.write1ByteTxOnly(port, 3, 68, 0)
    assert SDK.read1ByteTxRx(port, 3, LED)[1] == COMM_RX_TIMEOUT
    assert SDK.ping(port, 3)[1] == COMM_SUCCESS


def test_a_hardware_error_cuts_torque_until_a_reboot(port, emulator):
    SDK.write1ByteTxRx(port, 3, TORQUE, 1)
    emulator.servo("a").fail("overheating")
    assert SDK.read1ByteTxRx(port, 3, ERRORS) == (4, COMM_SUCCESS, ALERT)
    assert not emulator.torque()["a"]
    assert SDK.write1ByteTxRx(port, 3, TORQUE, 1) == (COMM_SUCCESS, RESULT | ALERT)
    assert SDK.reboot(port, 3)[0] == COMM_SUCCESS
    assert SDK.read1ByteTxRx(port, 3, ERRORS) == (0, COMM_SUCCESS, 0)
    assert SDK.write1ByteTxRx(port, 3, TORQUE, 1) == (COMM_SUCCESS, 0)


def test_two_hosts_one_after_the_other(emulator, monkeypatch):
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 150)
    for _ in range(2):
        handle = PortHandler(emulator.port)
        assert handle.setBaudRate(1_000_000)
        assert SDK.ping(handle, 3)[1] == COMM_SUCCESS
        handle.closePort()


# --- in process, where time is a number


def ask(bus, now, ident, instruction, params=b""):
    """Status packets as (seconds, id, error, data)."""
    replies = bus.exchange(build(ident, instruction, params), now, 1_000_000)
    found = [(after, Parser().feed(data)[0]) for after, data in replies]
    return [(after, p.id, p.params[0], p.params[1:]) for after, p in found]


def word(address, *data):
    return bytes([address, 0, *data])


def test_a_reply_takes_the_time_of_the_wire():
    bus = EmulatedBus(RIG, [0.0] * 3, CENTRE)
    now = time.monotonic()
    [(after, _, _, _)] = ask(bus, now, 3, Instruction.READ, word(POSITION, 4, 0))
    assert after == pytest.approx((14 + 15) * 10e-6 + 500e-6)  # both packets, and the return delay
    sync = ask(bus, now + 1, 254, Instruction.SYNC_READ, word(POSITION, 4, 0, 1, 3, 7))
    assert [s[1] for s in sync] == [1, 3, 7]
    assert sync[-1][0] == pytest.approx((17 + 3 * 15) * 10e-6 + 3 * 500e-6)
    [(fast, data)] = bus.exchange(
        build(254, Instruction.FAST_SYNC_READ, word(POSITION, 4, 0, 1, 3, 7)), now + 2, 1_000_000
    )
    assert len(data) == 8 + 3 * 8
    assert fast == pytest.approx((17 + 32) * 10e-6 + 500e-6)


def test_the_bus_watchdog_stops_a_silent_servo():
    bus = EmulatedBus(RIG, [0.0] * 3, CENTRE)
    t = time.monotonic()
    goal = word(GOAL) + (2048 + 1024).to_bytes(4, "little")
    for params in (word(TORQUE, 1), word(98, 5), goal):
        assert ask(bus, t, 3, Instruction.WRITE, params)[0][2] == 0
    ask(bus, t + 0.09, 7, Instruction.PING)  # a packet for another servo feeds it too
    servo = bus.servos[3]
    servo.advance(t + 0.18)
    assert servo.get("bus_watchdog") == 5
    servo.advance(t + 0.5)
    assert servo.get("bus_watchdog") == 255
    stopped = servo.get("present_position")
    # It ran from 0 to 0.19 s at no-load speed, 4.82 rad/s, and held its torque where it was then.
    assert stopped == pytest.approx(2048 + 0.19 * XM430.no_load_speed * 4096 / (2 * math.pi), abs=2)
    assert servo.get("torque_enable") == 1
    assert ask(bus, t + 0.6, 3, Instruction.WRITE, goal)[0][2] == RANGE
    assert ask(bus, t + 0.6, 3, Instruction.WRITE, word(98, 0))[0][2] == 0
    assert ask(bus, t + 0.6, 3, Instruction.WRITE, goal)[0][2] == 0
    servo.advance(t + 2)
    assert servo.get("present_position") == 3072


def test_profile_velocity_limits_the_speed():
    bus = EmulatedBus(RIG, [0.0] * 3, CENTRE)
    t = time.monotonic()
    for params in (word(112, 20, 0, 0, 0), word(TORQUE, 1), word(GOAL) + (3072).to_bytes(4, "little")):
        ask(bus, t, 3, Instruction.WRITE, params)
    servo = bus.servos[3]
    servo.advance(t + 1)
    assert servo.get("present_velocity") == 20
    moved = (servo.get("present_position") - 2048) * 2 * math.pi / 4096
    assert moved == pytest.approx(20 * 0.229 * 2 * math.pi / 60, rel=0.01)


def test_the_motor_against_small_steps():
    exact = Motor(4.8, 0.2)
    euler, v = 0.0, 0.0
    for k in range(1, 1001):
        exact.advance(0.0005, 1.0, 3.0)
        for _ in range(10):
            v = min(3.0, 4.8 * min(1.0, (1.0 - euler) / 0.2))
            euler += v * 0.00005
        if k % 100 == 0:
            assert exact.angle == pytest.approx(euler, abs=2e-4)
            assert exact.speed == pytest.approx(v, abs=5e-3)
    leap = Motor(4.8, 0.2)
    leap.advance(0.5, 1.0, 3.0)
    assert leap.angle == pytest.approx(exact.angle, abs=1e-12)


def test_full_pwm_of_the_default_gain():
    # 885 / (800 / 128) = 141.6 ticks of 4096
    assert full_error(800, 4096) == pytest.approx(math.radians(141.6 * 360 / 4096))


@given(address=st.integers(0, 150), data=st.binary(min_size=0, max_size=8), on=st.booleans())
@settings(max_examples=200, deadline=None)
def test_no_write_breaks_the_table(address, data, on):
    servo = EmulatedServo(X_SERIES, XM430, 3, 3, 2048, 0.0)
    servo.put("torque_enable", int(on))
    before = servo.read(0, 147)
    fault = servo.write(address, data)
    after = servo.read(0, 147)
    changed = [k for k in range(147) if before[k] != after[k]]
    assert all(address <= k < address + len(data) for k in changed)
    assert not (fault and changed)
    assert not (on and any(k < 64 for k in changed))
    servo.advance(1.0)


@given(data=st.binary(max_size=60), kind=st.sampled_from(Instruction), ident=st.sampled_from([1, 3, 254, 200]))
@settings(max_examples=200, deadline=None)
def test_no_packet_breaks_the_bus(data, kind, ident):
    bus = EmulatedBus(RIG, [0.0] * 3, CENTRE)
    now = time.monotonic()
    bus.exchange(build(ident, kind, data) + data, now, 1_000_000)
    bus.exchange(bytes(2000), now, 1_000_000)
    assert bus.servos[7].get("model_number") == 1060


def test_a_rig_that_cannot_be_emulated_is_one_clear_line():
    with pytest.raises(BusError, match="0 servos"):
        EmulatedBus(replace(RIG, servos=()))
    odd = replace(RIG.servos[0], model=replace(XM430, name="AX-12A"))
    with pytest.raises(BusError, match="'AX-12A' does not speak dynamixel2"):
        EmulatedBus(replace(RIG, servos=(odd,)))
    with pytest.raises(BusError, match="31250"):
        EmulatedBus(small_rig(baud=31250))
    assert Fault.ACCESS == ACCESS
