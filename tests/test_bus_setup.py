"""Scan, set-id, relax and monitor, on emulated buses of every family."""

import json

import pytest
from families import FAMILIES, rig_of

from drivers.bus import BusError
from drivers.emulation.emulator import Emulator
from drivers.emulation.in_process import InProcess
from drivers.emulation.tcp import TcpEmulator
from drivers.servos.connect import connect
from drivers.servos.port import Port
from drivers.servos.sdk import SdkAsker
from drivers.servos.setup import CodecAsker, Found, asker, relax, scan, set_id
from drivers.servos.table import FAMILIES as DRIVERS
from retarget.rig import load_rig
from rigcast.__main__ import main

PACKETS = {k: k.partition(" ")[0] for k in FAMILIES if k not in ("maestro", "ssc32")}


@pytest.fixture
def patient(monkeypatch):
    """Ports that wait long enough for an emulator's thread on a busy machine."""
    monkeypatch.setitem(Port.__init__.__kwdefaults__, "patience_s", 1.0)
    monkeypatch.setattr("drivers.servos.setup.SCAN_PATIENCE_S", 0.5)
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 100)


@pytest.mark.parametrize("kind", PACKETS)
def test_a_scan_finds_who_is_there_and_nobody_else(kind):
    rig = rig_of(kind)
    wire = InProcess(rig)
    bus, model = rig.buses[0], rig.servos[0].model.name
    told = []
    found = list(scan(wire, highest_id=9, told=lambda protocol, baud: told.append((protocol, baud))))
    assert [f for f in found if f.protocol == PACKETS[kind]] == [
        Found(PACKETS[kind], bus.baud, i, model) for i in (1, 3, 7)
    ]
    # A ping of protocol 1.0 and of Feetech are the same bytes; the model tells them apart.
    assert all(f.model.startswith("unknown") for f in found if f.protocol != PACKETS[kind])
    assert ("dynamixel2", 57600) in told
    assert wire.events("torque_enable") == []


@pytest.mark.parametrize("kind", PACKETS)
def test_a_new_id(kind):
    rig, protocol = rig_of(kind), PACKETS[kind]
    wire, baud = InProcess(rig), rig.buses[0].baud
    assert set_id(wire, protocol, baud, 3, 20).id == 20
    assert [f.id for f in scan(wire, protocols=(protocol,), bauds=(baud,), highest_id=30)] == [1, 7, 20]
    with pytest.raises(BusError, match="id 7 is taken"):
        set_id(wire, protocol, baud, 1, 7)
    with pytest.raises(BusError, match=f"no {protocol} servo 3 answers"):
        set_id(wire, protocol, baud, 3, 4)
    with pytest.raises(BusError, match=r"id 300; it is in 0…252"):
        set_id(wire, protocol, baud, 1, 300)
    with pytest.raises(BusError, match="'maestro' has no ids"):
        set_id(wire, "maestro", baud, 1, 2)


@pytest.mark.parametrize("kind", ["dynamixel2", "dynamixel1"])
def test_the_makers_sdk_scans_and_gives_ids_on_a_serial_path(kind, patient, monkeypatch):
    rig = rig_of(kind)
    bus, model = rig.buses[0], rig.servos[0].model.name
    monkeypatch.setattr("drivers.servos.setup.CodecAsker", None)
    with Emulator(rig) as emulator:

        def there():
            return [(f.id, f.model) for f in scan(emulator.port, protocols=(kind,), bauds=(bus.baud,), highest_id=7)]

        assert there() == [(1, model), (3, model), (7, model)]
        emulator.servo("a").put("torque_enable", 1)
        assert set_id(emulator.port, kind, bus.baud, 3, 5) == Found(kind, bus.baud, 5, model)
        assert emulator.get("b", "id") == 7
        assert [e.value for e in emulator.events("torque_enable")] == [0]
        assert there() == [(1, model), (5, model), (7, model)]
        with pytest.raises(BusError, match="id 7 is taken"):
            set_id(emulator.port, kind, bus.baud, 1, 7)
        with pytest.raises(BusError, match=f"no {kind} servo 3 answers"):
            set_id(emulator.port, kind, bus.baud, 3, 4)
        with SdkAsker(emulator.port, DRIVERS[kind], bus.baud), pytest.raises(BusError, match="another program has it"):
            there()
        emulator.unplug()
        with pytest.raises(BusError, match="cannot open serial port"):
            there()


def test_a_port_that_is_lost_under_the_sdk(patient):
    with Emulator(rig_of("dynamixel2")) as emulator, SdkAsker(emulator.port, DRIVERS["dynamixel2"], 1_000_000) as asked:
        assert asked.model(3) == "XM430-W350"
        emulator.unplug()
        with pytest.raises(BusError, match="is lost"):
            asked.model(3)


@pytest.mark.parametrize(
    ("wire", "protocol", "baud", "sdk"),
    [
        ("/dev/ttyUSB0", "dynamixel2", 57_600, True),
        ("COM3", "dynamixel1", 1_000_000, True),
        ("/dev/ttyUSB0", "dynamixel1", 400_000, False),  # a rate that the SDK does not open
        ("/dev/ttyUSB0", "feetech", 1_000_000, False),
        ("socket://127.0.0.1:9", "dynamixel2", 1_000_000, False),
    ],
)
def test_who_asks(wire, protocol, baud, sdk):
    assert isinstance(asker(wire, DRIVERS[protocol], baud), SdkAsker if sdk else CodecAsker)


@pytest.mark.parametrize("kind", FAMILIES)
def test_relax_lets_go_of_all_that_can_be_reached(kind):
    rig = rig_of(kind)
    wire = InProcess(rig)
    bus = connect(rig, wire)
    bus.__enter__()  # and never left: as after a program that was killed
    bus.torque(True)
    assert all(wire.torque().values())
    if kind in PACKETS:
        wire.remove("b")
    assert relax(rig, wire) == (["b"] if kind in PACKETS else [])
    assert not any(wire.torque().values())


def test_the_verbs(capsys, patient):
    with Emulator(load_rig("puppet")) as emulator:
        common = ["--port", emulator.port]
        scanned = [
            "bus",
            "scan",
            *common,
            "--protocol",
            "dynamixel2",
            "--baud",
            "1000000",
            "--highest-id",
            "2",
            "--json",
        ]
        assert main(scanned) == 0
        assert [(s["id"], s["model"]) for s in json.loads(capsys.readouterr().out)] == [
            (1, "XM430-W350"),
            (2, "XM430-W350"),
        ]
        assert main(["bus", "monitor", *common, "--seconds", "0"]) == 0
        assert "left_elbow" in capsys.readouterr().out
        assert main(["bus", "relax", *common]) == 0
        assert capsys.readouterr().out == "all limp\n"
        renamed = ["bus", "set-id", *common, "--protocol", "dynamixel2", "--old", "1", "--new", "40"]
        assert main(renamed) == 0
        assert capsys.readouterr().out == "XM430-W350 1 is now 40\n"
        assert main(renamed) == 2
        assert "no dynamixel2 servo 1 answers" in capsys.readouterr().err
        assert main(["bus", "scan", *common, "--protocol", "lx16a", "--highest-id", "1"]) == 1
        assert "nobody answers on" in capsys.readouterr().out
        assert main(["bus", "scan", *common, "--protocol", "morse"]) == 2


def test_a_bus_behind_a_tcp_port(patient):
    rig = rig_of("feetech")
    with TcpEmulator(rig, [0.2, -0.1, 0.0]) as emulator:
        for _ in range(2):  # one host after the other
            with connect(rig, emulator.port) as bus:
                assert bus.read().position == pytest.approx([0.2, -0.1, 0.0], abs=0.002)
                bus.torque(True)
                assert all(emulator.torque().values())
            assert not any(emulator.torque().values())
