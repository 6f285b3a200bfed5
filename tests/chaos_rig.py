"""A rig as a process of its own, on servos that are computed; writes what it does, a line of JSON a cycle, to a file.

python chaos_rig.py ADDRESS FILE SAFE_S
"""

import json
import sys

from small_rig import small_rig

from drivers.drive import Settings, drive
from drivers.frame import State
from drivers.receiver import Receiver
from drivers.simulated import SimulatedBus
from drivers.watchdog import Patience

HOLD_S = 0.3


class ToldReceiver(Receiver):
    """Tells of each poll: when, the mode after it, and which frame to follow was accepted."""

    def poll(self, now_ns):
        frame = super().poll(now_ns)
        told = None
        if frame is not None and frame.state == State.PLAY:
            told = [frame.stream, frame.seq, frame.capture_ns, float(frame.pos[0, 0])]
        tell(now=now_ns, mode=self.watchdog.mode, frame=told, refused=dict(self.gate.refused))
        return frame


class ToldBus(SimulatedBus):
    """Tells of each command."""

    def write(self, position):
        tell(command=position.tolist())
        super().write(position)


def tell(**what):
    out.write(json.dumps(what) + "\n")
    out.flush()


if __name__ == "__main__":
    rig = small_rig()
    patience = Patience(HOLD_S, float(sys.argv[3]))
    with open(sys.argv[2], "w") as out, ToldReceiver(sys.argv[1], rig_hash=rig.hash, patience=patience) as receiver:
        bus = ToldBus(rig)
        done = drive(rig, receiver, bus, Settings(settle_s=0.1))
        tell(ended=done.mode, reason=done.reason, torque=bus.on)
