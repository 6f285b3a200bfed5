"""What it costs and changes that retargeting puts several frames out of each solution: for the choice of `EACH`."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from motiongen.live.generator import LiveGenerator
from motiongen.motion import cut
from retarget.incoming import joined
from retarget.rig import load_rig
from retarget.streaming import advance, open_stream
from rigcast.service.line import FPS, LOOK_AHEAD_S, MOTION_FPS, STEP

PROMPTS = ("wave with the right hand", "bow", "raise both arms", "walk forward", "kick with the right foot", "squat")
EACH_S = 3.3


def each_solution(weights: Path, rig_name: str, quick: bool) -> dict[int, dict[str, float]]:
    """By frames a solution: processor time a second of motion, and by how much joints differ from one frame a solution,
    the root of the mean square and the most, in rad."""
    rig, live, motions = load_rig(rig_name), LiveGenerator(weights, seed=1), []
    for text in PROMPTS[: 2 if quick else None]:
        live.say(text, seconds=3.0)
        until = live.frame + round(EACH_S * MOTION_FPS)
        while live.frame < until:
            motions.append(live.next_chunk())
    motion = joined(*motions)
    out: dict[int, dict[str, float]] = {}
    alone = np.zeros((0, len(rig.joints)))
    for each in (1, 2, 3, 4):
        stream, progress = open_stream(
            rig, motion.skeleton, MOTION_FPS, mount="stand", fps=FPS, look_ahead=LOOK_AHEAD_S, each=each
        )
        rows, began = [], time.process_time()
        for start in range(0, len(motion) - STEP + 1, STEP):
            progress, streamed = advance(stream, progress, cut(motion, start, start + STEP))
            rows.append(streamed.qpos[:, 7:])
        took, joints = time.process_time() - began, np.concatenate(rows)
        alone = joints if each == 1 else alone
        off = joints - alone[: len(joints)]
        out[each] = {
            "s_a_second": round(took * MOTION_FPS / len(motion), 3),
            "off_rad": round(float(np.sqrt((off**2).mean())), 4),
            "most_rad": round(float(np.abs(off).max()), 3),
        }
    return out
