"""A take in a MuJoCo window, at real speed, with what is beside it and keys to pause, step and loop."""

from __future__ import annotations

import threading
import time

import mujoco
import numpy as np

from sim.look import build_stage
from sim.overlay import Overlay
from sim.player import Player
from sim.preview import Preview
from sim.window import opened_window

PERIOD = 1 / 60  # s between two looks at the clock
NEAR = 0.25  # s around the moment at which a check failed worst, in which it is named
SPACE, ENTER, RIGHT, LEFT, HOME = 32, 257, 262, 263, 268  # GLFW's codes
KEYS = "space\narrows\nhome\nenter\nT", "pause, go on\na frame on or back\nfrom the start\nloop or not\nsee through"
MOST_NAMED = 4  # failed checks that fit in the corner


def play_native(preview: Preview, *, player: Player | None = None, stop: threading.Event | None = None) -> None:
    """Show `preview` until the window is closed or `stop` is set. `player` says which frame.

    Raises RuntimeError as `opened_window` does.
    """
    playing = Player(len(preview), preview.fps) if player is None else player
    stage = build_stage(preview.rig, preview.mount)
    data, overlay = mujoco.MjData(stage.model), Overlay(preview, stage)
    actions = {
        SPACE: playing.toggle,
        RIGHT: lambda: playing.step(1),
        LEFT: lambda: playing.step(-1),
        HOME: lambda: playing.seek(0),
        ENTER: lambda: setattr(playing, "loop", not playing.loop),
    }
    with opened_window(
        stage, data, np.concatenate([preview.done, preview.asked]), lambda key: actions.get(key, lambda: None)()
    ) as window:
        shown = None
        while window.is_running() and not (stop and stop.is_set()):
            now = playing.frame, playing.running, playing.loop
            if now != shown:
                shown, frame = now, now[0]
                with window.lock():
                    stage.place(data, preview.done[frame])
                    window.cam.lookat[:2] = preview.done[frame, :2]
                    window.user_scn.ngeom = 0
                    overlay.add(window.user_scn, data, frame)
                window.set_texts(_texts(preview, playing, frame))
                window.sync()
            time.sleep(PERIOD)


def _texts(preview: Preview, player: Player, frame: int) -> list[tuple[int, int, str, str]]:
    """What is written in the corners: the prompt and the verdict, the moment, the keys."""
    font, grid = mujoco.mjtFontScale.mjFONTSCALE_100, mujoco.mjtGridPos
    at = frame / preview.fps
    failed = [check.name for check in preview.report.failures()]
    verdict = ["pass" if preview.report.ok else "fail", *failed[:MOST_NAMED]]
    if len(failed) > MOST_NAMED:
        verdict.append(f"and {len(failed) - MOST_NAMED} more")
    failing = [mark.name for mark in preview.marks() if abs(mark.at_s - at) < NEAR]
    state = ("playing" if player.running else "paused") + (", loop" if player.loop else "")
    moment = [("time", f"{at:.2f} of {(len(preview) - 1) / preview.fps:.2f} s"), ("", state)]
    if preview.footing is not None:
        moment.append(("ZMP inside", f"{1000 * preview.footing.zmp_margin[frame]:.0f} mm"))
    moment += [("FAILS", name) for name in failing[:MOST_NAMED]]
    left, right = zip(*moment, strict=True)
    return [
        (font, grid.mjGRID_TOPLEFT, _plain("\n".join([preview.title or preview.rig.name, *verdict])), ""),
        (font, grid.mjGRID_TOPRIGHT, "\n".join(left), "\n".join(right)),
        (font, grid.mjGRID_BOTTOMLEFT, *KEYS),
    ]


def _plain(text: str) -> str:
    """MuJoCo's font has ASCII alone."""
    return text.encode("ascii", "replace").decode()
