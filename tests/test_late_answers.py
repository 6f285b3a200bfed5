"""Answers that come too late carry no mark of their question: none may be taken for the answer to the next one."""

import pytest
from families import FAMILIES, rig_of

from drivers.emulation.in_process import InProcess
from drivers.emulation.noise import Noise
from drivers.servos.connect import connect
from drivers.servos.family import Request
from drivers.servos.port import Port
from drivers.servos.pwm import Maestro
from drivers.servos.table import family_of

PACKETS = [k for k in FAMILIES if k not in ("maestro", "ssc32")]


def question(family, model, name) -> Request:
    register = model.by_name[name]
    [request] = family.codec.read([3], register.address, register.size, group=False, fast=False)
    return request


def asked(kind, late_s, names):
    """What servo 3 is heard to say to each of the questions, all answers being late by `late_s`."""
    rig = rig_of(kind)
    family, wire = family_of(rig), InProcess(rig)
    model = family.models[rig.servos[0].model.name]
    with Port(wire, rig.buses[0].baud) as port:
        wire.noise = Noise(late_s=late_s)
        heard = [port.ask(family.codec, question(family, model, name)).get(3) for name in names]
    return wire, [None if r is None else model.by_name[n].decode(r.data) for r, n in zip(heard, names, strict=True)]


@pytest.mark.parametrize("kind", PACKETS)
@pytest.mark.parametrize("late_s", [0.0, 0.02, 0.045, 0.06, 0.08])
def test_a_late_answer_is_never_taken_for_another(late_s, kind):
    one, other = ("present_temperature", "id") if kind == "lx16a" else ("present_temperature", "torque_enable")
    wire, heard = asked(kind, late_s, [one, other] * 4)
    for name, value in zip([one, other] * 4, heard, strict=True):
        assert value in (None, wire.servo("a").get(name)), name
    assert (None not in heard) == (late_s < 0.03)


def test_the_same_question_may_be_answered_late():
    _, heard = asked("feetech", 0.045, ["present_temperature"] * 4)
    assert heard == [None, 30, 30, 30]


def test_the_last_of_several_late_answers_is_waited_for_too():
    wire, heard = asked("feetech", 0.045, ["present_temperature"] * 3 + ["torque_enable"])
    assert heard == [None, 30, 30, None]
    assert wire.servo("a").get("torque_enable") == 0


@pytest.mark.parametrize("late_s", [0.0, 0.02, 0.045, 0.06, 0.08])
def test_late_bytes_of_a_board_are_never_taken_for_another_answer(late_s):
    """A Maestro's answers are two bare bytes: no pulse, 00 00, looks like no error."""
    rig = rig_of("maestro")
    wire, board = InProcess(rig), Maestro()
    with connect(rig, wire) as bus:
        bus.torque(True)
        pulse = wire.get("a", "goal_position")
        with Port(wire, rig.buses[0].baud) as port:
            wire.noise = Noise(late_s=late_s)
            for (asked, size), truth in [(board.question((3,)), pulse * 4), (board.trouble(), 0)] * 4:
                heard = port.read_bytes(asked, size)
                assert int.from_bytes(heard, "little") == truth if len(heard) == size else late_s > 0.03
            wire.noise = Noise()
            wire.wait(0.2)
