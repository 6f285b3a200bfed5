"""`rigcast bus emulate`: the rig's servos on a pty, so that `rigcast drive` runs without hardware."""

from __future__ import annotations

import time

from retarget.rig import load_rig


def emulate(*, rig: str = "puppet") -> int:
    """Emulate the servo bus of a rig until Ctrl-C; prints the port to give to `rigcast drive --port`.

    Args:
        rig: Name of a rig (see `rigcast rigs`) or path of its folder.
    """
    from drivers.emulation.emulator import Emulator
    from drivers.signals import caught_signals

    with caught_signals() as caught, Emulator(load_rig(rig)) as emulator:
        print(emulator.port, flush=True)
        while not caught:
            time.sleep(0.1)
    return 0
