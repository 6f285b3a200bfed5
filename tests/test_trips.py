"""What ends a drive at once, on readings made up, and on servos of every make that get too hot or draw too much."""

from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, rig_of
from small_rig import small_rig
from test_faults import Stream

from drivers.bus import Reading
from drivers.drive import Settings, drive
from drivers.emulation.in_process import InProcess
from drivers.servos.connect import connect
from drivers.trips import Ceilings, Trips

S = 1_000_000_000
CEILINGS = Ceilings(np.full(2, 0.5), np.array([1.0, 2.0]), np.full(2, 65.0))
NOTHING = np.zeros(0)


def reading(current=(0.0, 0.0), temperature=(30.0, 30.0)):
    return Reading(np.zeros(2), np.array(current), np.array(temperature), np.full(2, 12.0))


def trips():
    made = Trips("ab", CEILINGS, following_s=0.5, load_s=1.0)
    made.start(0)
    return made


@pytest.mark.parametrize(
    ("error", "row", "seconds", "words"),
    [
        ((0.0, -0.6), reading(), 0.5, "b is -0.60 rad off its command: jammed or overloaded"),
        ((0.0, 0.0), reading(current=(-1.1, 1.9)), 1.0, "a draws -1.10 A (at most 1.00): jammed or overloaded"),
        ((0.0, 0.0), reading(current=(1.1, 2.9)), 1.0, "b draws +2.90 A (at most 2.00): jammed or overloaded"),
        ((0.0, 0.0), reading(temperature=(30.0, 66.0)), 1.0, "b is at 66 °C (at most 65)"),
    ],
)
def test_above_a_ceiling_for_too_long(error, row, seconds, words):
    watch, late = trips(), round(seconds * S)
    assert [watch.reason(np.array(error), row, t) for t in (0, late // 2, late)] == [""] * 3
    assert watch.reason(np.array(error), row, late + 1) == words
    watch.start(late + 2)
    assert watch.reason(np.array(error), row, late + 3) == ""


def test_one_good_reading_starts_the_clock_anew():
    watch, hot = trips(), reading(temperature=(80.0, 30.0))
    for t in range(20):
        row = reading() if t == 9 else hot
        assert watch.reason(np.zeros(2), row, t * S // 10) == ""
    assert watch.reason(np.zeros(2), hot, 2 * S).startswith("a is at 80")


def test_what_cannot_be_measured_is_not_watched():
    watch = trips()
    row = Reading(np.zeros(2), NOTHING, NOTHING, NOTHING)
    assert [watch.reason(np.zeros(2), row, t * S) for t in range(5)] == [""] * 5


@pytest.mark.parametrize("kind", [k for k in FAMILIES if k not in ("maestro", "ssc32")])
def test_a_hot_servo_ends_the_drive_limp(kind):
    rig = rig_of(kind)
    wire, stream = InProcess(rig), Stream(rig)

    def watch(state):
        if wire.now() > 0.7:
            wire.servo("b").put("present_temperature", 66)

    done = drive(rig, stream, connect(rig, wire), Settings(), clock=wire, watch=watch)
    assert (done.mode, done.reason) == ("tripped", "b is at 66 °C (at most 65)")
    assert not any(wire.torque().values())


def test_the_ceilings_are_the_rigs():
    rig = small_rig()
    assert rig.servos[0].max_current == pytest.approx(0.8 * 2.3)
    servos = tuple(replace(s, temperature_limit=31.0 if s.joint == "c" else None) for s in rig.servos)
    wire = InProcess(rig)
    for servo in "abc":
        wire.servo(servo).put("present_temperature", 40)
    rig = replace(rig, servos=servos)
    done = drive(rig, Stream(rig), connect(rig, wire), Settings(), clock=wire)
    assert done.reason == "c is at 40 °C (at most 31)"
