"""A motion that a hand shows to limp servos is the motion that is recorded."""

import numpy as np
import pytest
from families import FAMILIES, rig_of

from drivers.bus import BusError
from drivers.emulation.in_process import InProcess
from drivers.servos.by_hand import shown
from drivers.servos.connect import connect

PACKETS = [k for k in FAMILIES if k not in ("maestro", "ssc32")]


class Moved(InProcess):
    """Somebody swings joint a by hand: 0.4 rad to and fro, once in 2 s."""

    at = 0.0

    def sleep_until_ns(self, when_ns):
        super().sleep_until_ns(when_ns)
        at = 0.4 * np.sin(np.pi * self.now())
        self.bus.servos[3].motor.angle += at - self.at
        self.at = at


@pytest.mark.parametrize("kind", PACKETS)
def test_what_the_hand_does_is_what_is_written(kind):
    rig = rig_of(kind)
    wire = Moved(rig)
    with connect(rig, wire) as bus:
        bus.torque(True)
        began = wire.now()
        trajectory = shown(rig, bus, lambda seconds: seconds >= 3.0, wire)
        assert not any(wire.torque().values())
    assert trajectory.fps == 50.0
    assert trajectory.duration == pytest.approx(3.0, abs=0.1)
    assert trajectory.joints == ("a", "b", "c")
    first = wire.events("torque_enable")[-1].time
    assert first >= began
    a = trajectory.joint_pos[:, 0]
    assert a.max() - a.min() == pytest.approx(0.8, abs=0.06)
    assert abs(int(a[:100].argmax()) - int(a[:100].argmin())) / 50 == pytest.approx(1.0, abs=0.15)
    assert np.abs(trajectory.joint_pos[:, 1] + 0.1).max() < 0.01
    np.testing.assert_array_equal(trajectory.root_pos[:, 2], np.full(len(a), 0.1))


def test_nothing_shown_and_nothing_felt_is_one_line():
    rig = rig_of("feetech")
    with (
        connect(rig, InProcess(rig)) as bus,
        pytest.raises(BusError, match="nothing was recorded"),
    ):
        shown(rig, bus, lambda seconds: True, InProcess(rig))
    board = rig_of("maestro")
    wire = InProcess(board)
    with connect(board, wire) as bus, pytest.raises(BusError, match="cannot be felt"):
        shown(board, bus, lambda seconds: False, wire)
