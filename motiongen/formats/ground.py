"""The floor, for files whose heights say nothing about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from motiongen.motion import FOOT_JOINTS, Motion


def on_floor(motion: Motion) -> Motion:
    """The whole clip moved up or down so that its lowest foot joint is as high as on a flat sole on the floor (z = 0).

    Raises ValueError where the skeleton lacks one of `FOOT_JOINTS`.
    """
    feet = motion.positions()[:, [motion.skeleton.index(name) for name in FOOT_JOINTS], 2]
    lowest = (feet - np.tile(motion.skeleton.foot_height, 2)).min()
    return replace(motion, root_pos=motion.root_pos - [0.0, 0.0, lowest])
