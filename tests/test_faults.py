"""What goes wrong on a bus, for every make of servo: the safe state, in time, and a line that names what it was.

In process, on the emulated clock: the same each time, and no waiting. A cell that cannot be says why.
"""

import re
from dataclasses import replace
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest
from families import FAMILIES, rig_of
from small_rig import REPORT

from drivers.buffer import Buffer
from drivers.bus import BusError
from drivers.calibration import load_calibration
from drivers.drive import Settings, drive
from drivers.emulation.in_process import InProcess
from drivers.emulation.noise import Noise, hurt
from drivers.frame import Frame, State
from drivers.gate import Gate
from drivers.servos.connect import connect
from drivers.servos.family import Packet
from drivers.servos.table import FAMILIES as PROTOCOLS
from drivers.watchdog import Patience, Watchdog

PACKETS = tuple(k for k in FAMILIES if k not in ("maestro", "ssc32"))
BOARDS = ("maestro", "ssc32")
PLAY_S, FAULT_S = 1.6, 0.7
SETTINGS = Settings(settle_s=0.1, ease_velocity=2.0, following_error=0.2, following_s=0.2)


class Stream:
    """Stands in for a receiver: joint a swings for PLAY_S, then the stream ends."""

    def __init__(self, rig):
        self.rig, self.states = rig, []
        self.gate, self.watchdog = Gate(rig.hash), Watchdog(Patience(hold_s=0.3, safe_s=0.6))
        self.buffer, self.run, self.hello = Buffer(), 1, None

    def poll(self, now_ns):
        t = now_ns * 1e-9
        play = t < PLAY_S
        self.watchdog.fresh(State.PLAY if play else State.IDLE, now_ns)
        self.watchdog.update(now_ns)
        pos = np.array([[0.2 + 0.4 * 0.5 * (1 - np.cos(2 * np.pi * t)), -0.1, 0.0]])
        root = np.array([[0, 0, 0, 1.0, 0, 0, 0]])
        frame = Frame(1, 1, self.rig.hash, REPORT, now_ns, now_ns, 20_000_000, pos, 0 * pos, root, np.zeros(1))
        self.buffer.put(frame)
        return frame

    def send_state(self, state):
        self.states.append(state)


def play(kind, inject, **wire_options):
    """Drive the swing on an emulated bus of `kind` and have `inject(wire)` happen on the way; what came of it."""
    rig = rig_of(kind)
    wire, stream, at = InProcess(rig, **wire_options), Stream(rig), []

    def watch(state):
        if not at and wire.now() >= FAULT_S:
            at.append(wire.now())
            inject(wire)

    try:
        done = drive(rig, stream, connect(rig, wire), SETTINGS, clock=wire, watch=watch)
        mode, reason = done.mode, done.reason
    except BusError as error:
        mode, reason = stream.states[-1].mode, str(error)
        assert stream.states[-1].reason == reason[:1000] or "cut the power" in reason
    assert "\n" not in reason
    offs = [e.time for name in ("torque_enable", "goal_position") for e in wire.events(name) if e.value == 0]
    safe_at = min([t for t in offs if t > at[0]], default=wire.now())
    on = [j for j, is_on in wire.torque().items() if is_on]
    return SimpleNamespace(mode=mode, reason=reason, took=safe_at - at[0], wire=wire, on=on)


def assert_goals_within_limits(kind, wire):
    """Every byte that the host sent, heard by a bus without noise: no goal beyond the rig's limits."""
    rig = rig_of(kind)
    clean, calibration = InProcess(rig).bus, load_calibration(rig)
    for k, data in enumerate(wire.traffic):
        clean.exchange(data, k * 0.01, rig.buses[0].baud)
    goals = [e for e in clean.events if e.name == "goal_position" and not (kind in BOARDS and e.value == 0)]
    assert len(goals) > 60
    order = [s.id for s in rig.servos]
    ends = [calibration.ticks([getattr(j, end) for j in rig.joints]) for end in ("lower", "upper")]
    for event in goals:
        n = order.index(event.id)
        assert ends[0][n] <= event.value <= ends[1][n]


FEELS_NOTHING = "a hobby servo tells nobody"
SILENT = r"no answer on in process from servo 7 \(b\)"
REBOOTED = r"servo \d \([abc]\): (torque_enable|goal_speed|moving_speed) fell from \d+ to 0: it has rebooted"


def hardware(cause):
    """Expected of the families that name their errors; the LX-16A just lets go."""
    named = rf"servo 7 \(b\): hardware error: {cause}"
    limp = r"servo 7 \(b\): torque_enable fell from 1 to 0"
    return {**dict.fromkeys(PACKETS, named), "lx16a": limp, **dict.fromkeys(BOARDS, None)}


# fault: (what happens, seconds until the rig is safe, by family: the line that says so, or None where it cannot be)
FAULTS = {
    "dead servo": (lambda w: w.remove("b"), 0.4, {**dict.fromkeys(PACKETS, SILENT), **dict.fromkeys(BOARDS, None)}),
    "overload": (lambda w: w.servo("b").fail("overload"), 0.3, hardware("overload")),
    "overheating": (lambda w: w.servo("b").fail("overheating"), 0.3, hardware("overheating")),
    "undervoltage": (lambda w: w.servo("b").fail("input voltage"), 0.3, hardware("input voltage")),
    "brown-out": (
        lambda w: w.brown_out(),
        0.3,
        {**dict.fromkeys(PACKETS, REBOOTED), "maestro": r"servo \d \(.\): no pulse: .* restarted", "ssc32": None},
    ),
    "stuck joint": (
        lambda w: w.jam("a"),
        1.0,
        {**dict.fromkeys(PACKETS, r"^a is .* rad off its command: jammed"), **dict.fromkeys(BOARDS, None)},
    ),
    "unplugged": (lambda w: w.unplug(), 0.3, dict.fromkeys(FAMILIES, r"cut the power: serial port .* is lost")),
    "no byte gets through": (
        lambda w: setattr(w, "noise", Noise(drop=1.0)),
        3.5,
        {
            **dict.fromkeys(PACKETS, r"cut the power: no answer on in process"),
            "maestro": "pulses off is not confirmed, cut the power",
            "ssc32": None,
        },
    ),
}
CANNOT_BE = {
    "ssc32": "it answers nothing in the cycle: neither a restart nor a silent line shows",
    "maestro": FEELS_NOTHING,
}


@pytest.mark.parametrize("kind", FAMILIES)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_ends_in_the_safe_state_and_is_named(fault, kind):
    inject, deadline, expected = FAULTS[fault]
    if expected[kind] is None:
        assert kind in CANNOT_BE
        return
    done = play(kind, inject)
    assert done.mode == "tripped"
    assert re.search(expected[kind], done.reason), done.reason
    assert done.took < deadline
    reachable = fault not in ("unplugged", "no byte gets through")
    assert done.on == [] or not reachable
    assert_goals_within_limits(kind, done.wire)


RIDES = {
    "corrupted": Noise(corrupt=0.001),
    "dropped": Noise(drop=0.001),
    "doubled": Noise(double=0.001),
    "late": Noise(late_s=0.015),
}


@pytest.mark.parametrize("kind", PACKETS)
@pytest.mark.parametrize("noise", RIDES)
def test_a_little_damage_is_ridden_out(noise, kind):
    done = play(kind, lambda w: setattr(w, "noise", RIDES[noise]), seed=1)
    assert (done.mode, done.reason, done.on) == ("safe", "the stream ended", [])
    assert_goals_within_limits(kind, done.wire)


# A board answers bare bytes without a sum: what becomes of damage, by how much there is and what a Maestro says.
DAMAGE = {
    "corrupted": (Noise(corrupt=0.05), r"reports: serial|no pulse|no answer from the maestro"),
    "dropped": (Noise(drop=0.05), r"reports: serial|no pulse|no answer from the maestro"),
    "doubled": (Noise(double=0.05), r"reports: serial|no pulse|no answer from the maestro"),
    "late": (Noise(late_s=0.015), ""),
}


@pytest.mark.parametrize("noise", DAMAGE)
def test_damage_to_a_maestro_trips_it_and_an_ssc32_does_not_notice(noise):
    damage, says = DAMAGE[noise]
    done = play("maestro", lambda w: setattr(w, "noise", damage), seed=1)
    assert (done.mode, done.on) == ("tripped" if says else "safe", [])
    assert re.search(says, done.reason), done.reason
    assert_goals_within_limits("maestro", done.wire)
    done = play("ssc32", lambda w: setattr(w, "noise", damage), seed=1)
    assert done.mode == "safe"
    assert_goals_within_limits("ssc32", done.wire)


OTHER_RATE = {
    "dynamixel2": 57_600,
    "dynamixel1": 500_000,
    "feetech": 500_000,
    "feetech scs": 500_000,
    "maestro": 57_600,
}


@pytest.mark.parametrize("kind", [*OTHER_RATE, "ssc32"])
def test_a_wrong_rate_is_told_before_anything_moves(kind):
    """An LX-16A has one rate only."""
    rig = rig_of(kind)
    wire, baud = InProcess(rig), OTHER_RATE.get(kind, 9600)
    slow = replace(rig, buses=(replace(rig.buses[0], baud=baud),))
    with pytest.raises(BusError, match=rf"no \w+ (servo )?answers on in process at {baud} baud"), connect(slow, wire):
        pass
    assert wire.events("torque_enable") == wire.events("goal_position") == []


@pytest.mark.parametrize("kind", PACKETS)
def test_two_servos_with_one_id_are_told_before_anything_moves(kind):
    rig = rig_of(kind)
    wire = InProcess(rig)
    wire.servo("b").put("id", 3)
    with pytest.raises(BusError, match=r"no answer on in process from servo 7 \(b\)"), connect(rig, wire):
        pass
    crowded, stranger = InProcess(rig), InProcess(rig).servo("a")
    stranger.motor.angle += 0.3
    crowded.bus.servos[100] = stranger
    expected = r"garbled answers on in process from servo 3 \(a\): two servos with one id"
    with pytest.raises(BusError, match=expected), connect(rig, crowded):
        pass


@pytest.mark.parametrize("kind", PACKETS)
def test_what_slips_through_a_checksum(kind):
    """10 % of the bytes of 10,000 answers replaced at random: no more pass than the sum must let through."""
    family = PROTOCOLS["feetech" if kind == "feetech scs" else kind]
    model = family.models[rig_of(kind).servos[0].model.name]
    block = model.block(model.state)
    bus, random, noise = InProcess(rig_of(kind)).bus, Random(7), Noise(corrupt=0.1)
    [request] = family.codec.read([3], block.address, block.size, group=model.group_read, fast=False)
    [(_, good)] = bus.exchange(request.data, 0.0, rig_of(kind).buses[0].baud)
    [truth] = family.codec.parser().feed(good)
    damaged = wrong = 0
    for _ in range(10_000):
        heard = hurt(good, noise, random)
        damaged += heard != good
        found: list[Packet] = family.codec.parser().feed(heard)
        wrong += any(r.id == 3 and len(r.data) == block.size and p != truth
                     for p in found for r in family.codec.replies(p, request))  # fmt: skip
    share = 1 / 65536 if kind == "dynamixel2" else 1 / 256
    assert damaged > 5000
    assert wrong <= damaged * share + 4 * (damaged * share) ** 0.5 + 1


@pytest.mark.parametrize("kind", PACKETS)
def test_no_reading_moves_faster_than_the_servo_can(kind):
    """False positions that pass the sum, from a joint that stands still: none of them is taken."""
    rig = rig_of(kind)
    wire = InProcess(rig)
    told = r"servo 3 \(a\): says that it is at -?\d+ ticks, where it cannot have got to"
    with connect(rig, wire) as bus:
        bus.torque(True)
        start = bus.read().position
        wire.jam("a")
        motor = wire.servo("a").motor
        for k in range(9):
            wire.wait(0.02)
            if k % 3 == 2:
                motor.angle += 0.8
                with pytest.raises(BusError, match=told):
                    bus.read()
                motor.angle -= 0.8
            np.testing.assert_allclose(bus.read().position, start, atol=0.02)
