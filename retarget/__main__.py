"""Compiles the loops of the solver, for which the first clip would otherwise wait: `python -m retarget`."""

from __future__ import annotations

from motiongen.gestures.catalogue import perform
from retarget import loops
from retarget.retarget import retarget
from retarget.rig import load_rig

CLIPS = "wave", "turn"  # what reaches every loop


def main() -> None:
    if not loops.kept():
        for name in CLIPS:
            retarget(perform(name, seed=0), load_rig("puppet"), mount="free")


if __name__ == "__main__":
    main()
