"""Packets, registers, calibration and the simulated bus, against the vendor's SDK and tables."""

import math
from pathlib import Path

import dynamixel_easy_sdk
import numpy as np
import pytest
from dynamixel_sdk import Protocol2PacketHandler
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from small_rig import small_rig

from drivers.bus import BusError
from drivers.calibration import Calibration, load_calibration
from drivers.servos.dynamixel2 import Instruction, Parser, build, crc16, status
from drivers.servos.x_series import X_SERIES
from drivers.simulated import SimulatedBus

RIG = small_rig()
TICK = 2 * math.pi / 4096
CENTRE = Calibration(np.ones(3, np.int64), np.full(3, 2048), np.full(3, 4096))

# Instruction packets of the e-Manual's examples, whole; their CRCs are what is tested.
OFFICIAL = {
    "ping": (build(1, Instruction.PING), "FF FF FD 00 01 03 00 01 19 4E"),
    "broadcast ping": (build(254, Instruction.PING), "FF FF FD 00 FE 03 00 01 31 42"),
    "read": (build(1, Instruction.READ, bytes([132, 0, 4, 0])), "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"),
    "write": (
        build(1, Instruction.WRITE, bytes([116, 0, 0, 2, 0, 0])),
        "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
    ),
    "sync read": (
        build(254, Instruction.SYNC_READ, bytes([132, 0, 4, 0, 1, 2])),
        "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
    ),
    "sync write": (
        build(254, Instruction.SYNC_WRITE, bytes([116, 0, 4, 0, 1, 150, 0, 0, 0, 2, 170, 0, 0, 0])),
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
}


class Wire:
    """Stands in for the SDK's port: gives what is to be read."""

    def __init__(self, incoming):
        self.is_using, self.incoming = False, incoming

    def readPort(self, length):
        out, self.incoming = self.incoming[:length], self.incoming[length:]
        return out

    def isPacketTimeout(self):
        return not self.incoming


# Bytes that stuffing and header search trip over, and ordinary ones.
PARAMS = st.lists(st.sampled_from([0xFF, 0xFF, 0xFD, 0xFD, 0x00, 0x01, 0x55]), max_size=40).map(bytes)


@pytest.mark.parametrize("name", OFFICIAL)
def test_official_packets(name):
    ours, official = OFFICIAL[name]
    assert ours == bytes.fromhex(official)
    assert crc16(ours) == crc16(ours[-2:], crc16(ours[:-2]))


@given(ident=st.integers(0, 253), params=PARAMS)
@settings(max_examples=50, deadline=None)
def test_the_sdk_stuffs_and_sums_the_same(ident, params):
    sdk = Protocol2PacketHandler()
    draft = [0xFF, 0xFF, 0xFD, 0x00, ident, len(params) + 3, 0, 0x03, *params, 0, 0]
    # Its txPacket drops what addStuffing returns and sends such packets unstuffed; the pieces are right.
    stuffed = sdk.addStuffing(draft)[:-2]
    theirs = bytes(stuffed) + sdk.updateCRC(0, stuffed, len(stuffed)).to_bytes(2, "little")
    assert build(ident, Instruction.WRITE, params) == theirs
    [packet] = Parser().feed(theirs)
    assert (packet.id, packet.code, packet.params) == (ident, 0x03, params)


@given(ident=st.integers(0, 252), params=PARAMS)
@settings(max_examples=50, deadline=None)
def test_the_sdk_reads_our_status_packets(ident, params):
    assume(b"\xff\xfd\xfd" not in params)  # The SDK unstuffs in place and loses a byte where one follows another.
    packet, result = Protocol2PacketHandler().rxPacket(Wire(status(ident, 0, params)), False)
    assert result == 0
    assert packet[4] == ident
    assert bytes(packet[9 : 9 + len(params)]) == params


@given(
    data=st.lists(st.one_of(st.binary(max_size=12), PARAMS.map(lambda p: build(5, 3, p))), max_size=8), cut=st.data()
)
@settings(deadline=None)
def test_the_parser_finds_packets_in_any_pieces(data, cut):
    stream = b"".join(data) + build(9, 2, b"\x01\x02\x03\x04")
    whole = Parser().feed(stream)
    parser, pieces, at = Parser(), [], 0
    while at < len(stream):
        size = cut.draw(st.integers(1, 9))
        pieces += parser.feed(stream[at : at + size])
        at += size
    assert pieces == whole


def test_the_parser_survives_damage():
    good = build(1, 3, b"\x74\x00\x01")
    bad = bytearray(good)
    bad[8] ^= 1
    parser = Parser()
    assert [p.params for p in parser.feed(b"\xff\xff" + bytes(bad) + good)] == [b"\x74\x00\x01"]
    assert parser.damaged == 1


@pytest.mark.parametrize("model", X_SERIES.models)
def test_registers_are_those_of_the_vendors_tables(model):
    folder = Path(dynamixel_easy_sdk.__file__).parent / "control_table"
    rows = (folder / f"{model.lower().replace('-', '_')}.model").read_text().split("[control table]")[1].splitlines()
    vendor = {}
    for address, size, name in (r.split("\t") for r in rows[2:] if r.strip()):
        vendor.setdefault(name.lower().split("(")[0].replace(" ", "_"), (int(address), int(size)))
    vendor["secondary_id"] = vendor.pop("secondary") if "secondary" in vendor else vendor.get("secondary_id")
    vendor["present_current"] = vendor.get("present_current") or vendor.get("present_load")
    ours = X_SERIES.models[model]
    names = [r.name for r in ours.registers if not r.name.startswith("indirect_address_")]
    missing = [n for n in names if vendor.get(n) is None]
    assert missing in ([], ["secondary_id"])
    wrong = [n for n in names if n not in missing and vendor[n] != (ours.by_name[n].address, ours.by_name[n].size)]
    assert wrong == []
    if ours.indirect is not None:
        assert ours.indirect == (vendor["indirect_address_1"][0], vendor["indirect_data_1"][0])
        assert ours.by_name["indirect_address_28"].address == ours.indirect[0] + 54
    assert ("goal_current" in ours.by_name) == ("goal_current" in vendor)


# --- calibration


def test_default_calibration_and_a_file(tmp_path):
    assert load_calibration(RIG, tmp_path / "none.toml").ticks([0.0, TICK, -TICK]).tolist() == [2048, 2049, 2047]
    path = tmp_path / "small.toml"
    path.write_text("[b]\ndirection = -1\nzero = 2000\n")
    given = load_calibration(RIG, path)
    assert given.ticks([0.0, 0.5, 0.0]).tolist() == [2048, 2000 - round(0.5 / TICK), 2048]
    np.testing.assert_allclose(given.angle(given.ticks([0.3, 0.5, -0.7])), [0.3, 0.5, -0.7], atol=TICK / 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[x]\nzero = 1", "'x'"),
        ("[a]\ndirection = 0", "direction 0"),
        ("[a]\nzero = 4096", "zero 4096; it is in 0…4095"),
        ("[a]\nzero = 1.5", "zero 1.5"),
        ("[a]\noffset = 1", "offset"),
        ("[a", "small.toml"),
    ],
)
def test_a_wrong_calibration_is_one_clear_line(tmp_path, text, message):
    path = tmp_path / "small.toml"
    path.write_text(text)
    with pytest.raises(BusError, match=message) as caught:
        load_calibration(RIG, path)
    assert "\n" not in str(caught.value)


def test_the_simulated_bus_moves_like_its_motors():
    class At:
        ns = 0

        def now_ns(self):
            return self.ns

        def sleep_until_ns(self, when_ns):
            self.ns = when_ns

    clock = At()
    with SimulatedBus(RIG, [0.0] * 3, clock=clock) as bus:
        bus.write(np.ones(3))
        clock.ns = 10**9
        assert bus.read().position.tolist() == [0, 0, 0]
        bus.torque(True)
        bus.write(np.array([1.0, 0.0, 0.0]))
        clock.ns += 10**8
        assert bus.read().position[0] == pytest.approx(0.3)  # 0.1 s at the joint's 3 rad/s
        clock.ns += 10**9
        assert bus.read().position[0] == pytest.approx(1.0, abs=1e-6)
    assert not bus.on
