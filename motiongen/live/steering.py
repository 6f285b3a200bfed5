"""Where to go, beside what to do: twelve numbers a frame that a live network hears, each group of them or not.

| columns | what | unit |
|---|---|---|
| 0:3 | yaw rate and planar velocity of the pelvis, without the sway of the strides | normalised as the features are |
| 3 | whether they are given | 0 or 1 |
| 4:7, 8:11 | left and right wrist in the heading frame, from below the pelvis at the height of the floor | 0.5 m |
| 7, 11 | whether it is given | 0 or 1 |
"""

from __future__ import annotations

from motiongen.motion import SMPL_JOINTS

WIDTH = 12
ROOT, ROOT_GIVEN = slice(0, 3), 3
HANDS = (slice(4, 7), slice(8, 11))
HANDS_GIVEN = (7, 11)
WRISTS = [SMPL_JOINTS.index(f"{side}_wrist") for side in ("left", "right")]
METRES = 0.5  # that a wrist's numbers count in
SWAY = 21  # frames over which speed and turn are averaged: a stride
