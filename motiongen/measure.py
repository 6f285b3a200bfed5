"""What a clip says by itself: counts, metres and degrees, measured from the motion without any network.

python -m motiongen.measure FILE
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from motiongen import measure_arms as arms
from motiongen import measure_legs as legs
from motiongen.motion import SMPL_JOINTS, Motion

FPS = 30.0  # what every clip is measured at, so that its own rate changes nothing


@dataclass(frozen=True)
class Measured:
    """What a motion shows.

    Units stand in the names. `path_m` runs along the pelvis's way, `net_m` straight from start to end; `turn_deg` is
    from start to end too, positive to the left. A wave is a swing of the hand in and out again; `perhaps` counts what
    might be one as well, so that where it differs the waves are not sure. A head shake is from side to side and back,
    counted in halves. `bow_deg` is the deepest bow, 0 without one, `chest_pitch_deg` the furthest that the chest leans
    forward; `jump_height_m` the pelvis's highest rise above standing, 0 without a jump.
    """

    duration_s: float
    left_steps: int
    right_steps: int
    path_m: float
    net_m: float
    mean_speed_m_s: float
    turn_deg: float
    left_waves: int
    right_waves: int
    left_perhaps: int
    right_perhaps: int
    left_raises: int
    right_raises: int
    nods: int
    head_shakes: float
    claps: int
    bows: int
    bow_deg: float
    chest_pitch_deg: float
    squats: int
    jumps: int
    jump_height_m: float

    @property
    def steps(self) -> int:
        """Steps of both feet."""
        return self.left_steps + self.right_steps


def measure(motion: Motion) -> Measured:
    """Measure a motion that stands on the floor z = 0 or any other level one.

    Raises ValueError where the skeleton lacks one of the 22 joints of SMPL.
    """
    if missing := [name for name in SMPL_JOINTS if name not in motion.skeleton.names]:
        raise ValueError(f"cannot measure a skeleton without {', '.join(missing)}")
    seconds = motion.duration
    motion = motion.resampled(FPS)
    at = motion.positions()
    pelvis = at[:, 0]
    found = legs.feet(motion, at)
    left, right = legs.steps(motion, found)
    along, net = legs.way(pelvis)
    jumped, high = legs.jumps(motion, pelvis, found)
    squatted = legs.squats(motion, pelvis, found, jumped)
    low = np.quantile(pelvis[:, 2], 0.9) - pelvis[:, 2]
    bows, deepest, pitch = arms.bows(motion, low, np.all(found.still, axis=1))
    (left_waves, left_perhaps), (right_waves, right_perhaps) = (arms.waves(motion, at, s) for s in ("left", "right"))
    nods, shakes = arms.head(motion)
    return Measured(
        duration_s=seconds, left_steps=left, right_steps=right,
        path_m=along, net_m=net, mean_speed_m_s=along / seconds if seconds else 0.0, turn_deg=legs.turn(motion),
        left_waves=left_waves, right_waves=right_waves, left_perhaps=left_perhaps, right_perhaps=right_perhaps,
        left_raises=arms.raises(motion, at, "left"), right_raises=arms.raises(motion, at, "right"),
        nods=nods, head_shakes=shakes, claps=arms.claps(motion, at),
        bows=bows, bow_deg=deepest, chest_pitch_deg=pitch,
        squats=len(squatted), jumps=len(jumped), jump_height_m=high,
    )  # fmt: skip


def mirrored(measured: Measured) -> Measured:
    """What the mirror image of a motion that was `measured` shows."""
    here = asdict(measured)
    there = {"left": "right", "right": "left"}
    sides = {name: here[name.replace(side, there[side])] for name in here for side in there if name.startswith(side)}
    return Measured(**{**here, **sides, "turn_deg": -measured.turn_deg})


def main(path: Path) -> int:
    """Print what a motion in a file shows and what a caption may say of it; the exit code, 2 where it is unreadable."""
    from motiongen.reading import read_motion
    from motiongen.say_numbers import clauses

    try:
        found = measure(read_motion(path))
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    for field in fields(found):
        print(f"{field.name:16} {getattr(found, field.name):8.4g}")
    for clause in clauses(found):
        print(clause)
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m motiongen.measure FILE")
    sys.exit(main(Path(sys.argv[1])))
