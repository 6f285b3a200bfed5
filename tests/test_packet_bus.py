"""The driver of packet servos, on an emulated bus of Dynamixel X servos; the other makes are in test_families.py."""

import errno
import grp
import math
from dataclasses import replace

import numpy as np
import pytest
from small_rig import XM430, small_rig

from drivers.bus import BusError
from drivers.calibration import Calibration
from drivers.emulation.emulator import Emulator
from drivers.emulation.in_process import InProcess
from drivers.servos.dynamixel2 import Instruction, Parser
from drivers.servos.packet_bus import PacketBus
from drivers.servos.port import Port, why_not_opened
from retarget.rig import Bus

RIG = small_rig()
TICK = 2 * math.pi / 4096
CENTRE = Calibration(np.ones(3, np.int64), np.full(3, 2048), np.full(3, 4096))


def rows(bus, wire, goal, cycles):
    """The last reading of so many cycles of 20 ms towards `goal`."""
    for _ in range(cycles):
        wire.wait(0.02)
        reading = bus.read()
        bus.write(np.array(goal))
    return reading


def test_the_driver_measures_and_moves():
    backwards = replace(CENTRE, direction=np.array([1, -1, 1]))
    wire = InProcess(RIG, [0.2, -0.1, 0.0], backwards)
    with PacketBus(RIG, wire, calibration=backwards) as bus:
        reading = bus.read()
        np.testing.assert_allclose(reading.position, [0.2, -0.1, 0.0], atol=TICK / 2)
        assert reading.voltage.tolist() == pytest.approx([12.0, 11.1, 12.0])
        assert reading.temperature.tolist() == [30, 30, 30]
        assert wire.get("b", "present_position") == 2048 + round(0.1 / TICK)
        with pytest.raises(BusError, match="torque is off"):
            bus.write(np.array([1.0, 1.0, 1.0]))
        bus.torque(True)
        np.testing.assert_allclose(bus.read().position, [0.2, -0.1, 0.0], atol=TICK)
        np.testing.assert_allclose(rows(bus, wire, [0.3, -0.2, 0.1], 40).position, [0.3, -0.2, 0.1], atol=TICK)
        assert all(wire.torque().values())
        assert wire.get("a", "bus_watchdog") == 25
        assert wire.get("a", "return_delay_time") == 0
    assert not any(wire.torque().values())


def test_a_cycle_is_one_write_of_goals_and_request_and_one_packet_back():
    wire = InProcess(RIG, [0.0] * 3, CENTRE)
    with PacketBus(RIG, wire, calibration=CENTRE) as bus:
        bus.torque(True)
        rows(bus, wire, [0.1, 0.1, 0.1], 3)
        wire.traffic.clear()
        before = wire.now()
        rows(bus, wire, [0.1, 0.1, 0.1], 5)
        assert len(wire.traffic) == 5
        assert wire.now() - before == pytest.approx(5 * 0.02)  # The answers were there: nothing was waited for.
        goals, request = Parser().feed(wire.traffic[0])
        assert (goals.code, request.code) == (Instruction.SYNC_WRITE, Instruction.FAST_SYNC_READ)
        assert request.params[:4] == bytes([224, 0, 11, 0])  # torque, error, current, position, voltage, temperature


def test_a_jammed_servo_shows_its_stall_current():
    wire = InProcess(RIG, [0.0] * 3, CENTRE)
    with PacketBus(RIG, wire, calibration=CENTRE) as bus:
        bus.torque(True)
        wire.jam("a")
        reading = rows(bus, wire, [1.0, 0.0, 0.0], 3)
        assert reading.current.tolist() == pytest.approx([XM430.stall_current, 0, 0], abs=2.69e-3)


def test_no_fast_sync_read_falls_back_to_the_ordinary_one(monkeypatch):
    monkeypatch.setattr("drivers.emulation.protocol2._fast_read", lambda line, params: iter(()))
    wire = InProcess(RIG, calibration=CENTRE)
    with PacketBus(RIG, wire, calibration=CENTRE) as bus:
        for _ in range(5):
            np.testing.assert_allclose(bus.read().position, [0.2, -0.1, 0.0], atol=TICK / 2)
        wire.traffic.clear()
        bus.read()
        assert Parser().feed(b"".join(wire.traffic))[0].code == Instruction.SYNC_READ


def test_a_hardware_error_is_decoded():
    wire = InProcess(RIG, calibration=CENTRE)
    with PacketBus(RIG, wire, calibration=CENTRE) as bus:
        bus.torque(True)
        wire.servo("b").fail("overload")
        with pytest.raises(BusError, match=r"servo 7 \(b\): hardware error: overload"):
            bus.read()
        with pytest.raises(BusError, match=r"servo 7 \(b\): hardware error: overload"):
            bus.torque(True)


def test_silence_stops_the_servos_and_is_told():
    wire = InProcess(RIG, calibration=CENTRE)
    with PacketBus(RIG, wire, calibration=CENTRE, watchdog_s=0.02) as bus:
        bus.torque(True)
        wire.wait(0.06)
        bus.read()
        with pytest.raises(BusError, match="the servos stopped themselves"):
            bus.write(np.zeros(3))
        assert wire.get("a", "bus_watchdog") == 255
        bus.torque(True)
        bus.write(np.zeros(3))


def test_what_is_not_there_is_one_clear_line():
    def opening(rig, port, **options):
        with PacketBus(rig, port, calibration=CENTRE, **options):
            raise AssertionError("it opened")

    with pytest.raises(BusError, match=r"cannot open serial port '/dev/ttyNONE': No such file") as caught:
        opening(RIG, "/dev/ttyNONE")
    assert "\n" not in str(caught.value)
    wire = InProcess(RIG, calibration=CENTRE)
    slow = replace(RIG, buses=(Bus("main", "dynamixel2", 57600),))
    with pytest.raises(BusError, match=r"no dynamixel2 servo answers on .* at 57600 baud"):
        opening(slow, wire)
    with pytest.raises(BusError, match="no dynamixel2 servo runs at 31250 baud"):
        opening(replace(RIG, buses=(Bus("main", "dynamixel2", 31250),)), wire)
    with pytest.raises(BusError, match=r"servo 7 \(b\): model 1060; the rig names XM430-W350, 1020"):
        opening(replace(RIG, servos=tuple(replace(s, model=XM430) for s in RIG.servos)), wire)
    wire.remove("b")
    with pytest.raises(BusError, match=r"no answer on .* from servo 7 \(b\)$"):
        opening(RIG, wire)
    with pytest.raises(BusError, match="watchdog_s 9"):
        opening(RIG, "/dev/null", watchdog_s=9)
    with pytest.raises(BusError, match="0 servos on 1 buses"):
        opening(replace(RIG, servos=()), "/dev/null")
    wide = replace(RIG, joints=tuple(replace(j, lower=-4.0) for j in RIG.joints))
    with pytest.raises(BusError, match=r"joint 'a': its limits are ticks -560…3026"):
        opening(wide, "/dev/null")


def test_why_a_port_does_not_open(tmp_path):
    mine = tmp_path / "tty"
    mine.touch()
    group = grp.getgrgid(mine.stat().st_gid).gr_name
    assert f"group {group!r}" in why_not_opened(str(mine), PermissionError(errno.EACCES, "no"))
    assert why_not_opened("x", OSError(errno.EBUSY, "no")) == "another program has it open"
    with (
        Emulator(RIG, calibration=CENTRE) as emulator,
        Port(emulator.port, 1_000_000),
        pytest.raises(BusError, match="another program has it open"),
        Port(emulator.port, 1_000_000),
    ):
        pass


def test_a_pulled_cable_is_one_clear_line():
    wire = InProcess(RIG, calibration=CENTRE)

    def pull():
        with PacketBus(RIG, wire, calibration=CENTRE) as bus:
            bus.torque(True)
            wire.unplug()
            bus.read()

    with pytest.raises(BusError, match=r"torque off is not confirmed, cut the power: .* is lost") as caught:
        pull()
    assert "is lost" in str(caught.value.__context__)


def test_a_pulled_cable_of_a_real_port_is_one_clear_line():
    with Emulator(RIG, calibration=CENTRE) as emulator, Port(emulator.port, 1_000_000) as port:
        emulator.unplug()
        with pytest.raises(BusError, match=r"serial port .* is lost"):
            port.send(b"x")
