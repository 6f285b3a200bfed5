"""The guard process: the rig is limp soon after its driver was killed, whatever the servos and whatever the moment."""

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from families import FAMILIES, rig_of

from drivers.bus import BusError
from drivers.emulation.emulator import Emulator
from drivers.servos.connect import connect
from drivers.servos.port import Port

TESTS = Path(__file__).parent
LIMP_S = 5.0  # That it happens is tested here; how soon depends on what else the machine does.
DRIVER = """
import sys, time
from families import rig_of
from drivers.servos.connect import connect
from drivers.servos.packet_bus import PacketBus
from drivers.servos.port import Port
PacketBus.__init__.__kwdefaults__["watchdog_s"] = 2.5
Port.__init__.__kwdefaults__["patience_s"] = 1.0
kind, port, silence_s = sys.argv[1], sys.argv[2], float(sys.argv[3])
with connect(rig_of(kind), port, guarded=True, silence_s=silence_s) as bus:
    bus.torque(True)
    start = bus.read().position
    print("on", flush=True)
    for k in range(10**6):
        bus.write(start + 0.1 * (k % 7) / 7)
        bus.read()
        time.sleep(0.01)
"""


@contextmanager
def driven(kind, emulator, silence_s=60.0):
    """A process that moves the servos, once it does."""
    command = [sys.executable, "-c", DRIVER, kind, emulator.port, str(silence_s)]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), str(TESTS.parent)])}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env) as process:
        try:
            assert process.stdout.readline() == "on\n"
            yield process
        finally:
            process.kill()


def assert_goes_limp(emulator):
    """All let go within LIMP_S, and stay so."""
    until = time.monotonic() + LIMP_S
    while any(emulator.torque().values()):
        assert time.monotonic() < until, emulator.torque()
        time.sleep(0.005)
    time.sleep(0.15)
    assert not any(emulator.torque().values())


@pytest.mark.parametrize("kind", FAMILIES)
def test_a_killed_driver_leaves_a_limp_rig(kind):
    with Emulator(rig_of(kind)) as emulator, driven(kind, emulator) as process:
        time.sleep(random.uniform(0.0, 0.1))
        assert all(emulator.torque().values())
        process.kill()
        assert_goes_limp(emulator)


def test_a_driver_that_hangs_is_taken_for_dead():
    with Emulator(rig_of("feetech")) as emulator, driven("feetech", emulator, silence_s=2.0) as process:
        process.send_signal(signal.SIGSTOP)
        assert_goes_limp(emulator)
        process.send_signal(signal.SIGCONT)
        assert process.wait(60) == 1  # It finds its port gone.
        assert not any(emulator.torque().values())


def test_a_guarded_bus_ends_like_any_other_and_frees_the_port(monkeypatch):
    monkeypatch.setitem(Port.__init__.__kwdefaults__, "patience_s", 1.0)
    rig = rig_of("feetech")
    with Emulator(rig, [0.2, -0.1, 0.0]) as emulator:
        for _ in range(2):
            with connect(rig, emulator.port, guarded=True, silence_s=60.0) as bus:
                assert bus.read().position == pytest.approx([0.2, -0.1, 0.0], abs=0.002)
                bus.torque(True)
                with pytest.raises(BusError, match="another program has it open"), connect(rig, emulator.port):
                    pass
            assert not any(emulator.torque().values())


def test_what_the_guard_cannot_open_is_said_in_one_line():
    with pytest.raises(BusError, match="cannot open serial port '/dev/none': No such file"):
        connect(rig_of("feetech"), "/dev/none", guarded=True).__enter__()
