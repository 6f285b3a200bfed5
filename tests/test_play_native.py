"""The window as a user sees it: the rig, the ghost of its target, the words, and keys that work."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import mujoco
import numpy as np
import pytest
from displays import grab, virtual_display
from two_arm_rig import two_arm_motion, two_arm_rig

from sim.checks import judge
from sim.look import build_stage
from sim.overlay import EDGE, INSIDE, OUTSIDE, TARGET, Overlay
from sim.play_native import ENTER, HOME, LEFT, RIGHT, SPACE, play_native
from sim.player import Player
from sim.preview import Preview, prepare

WINDOW = """
import sys, threading
from pathlib import Path
sys.path[:0] = {path!r}
from test_play_native import preview_of_a_throw
from sim.play_native import play_native
from sim.player import Player
preview, stop = preview_of_a_throw(Path({folder!r})), threading.Event()
player = Player(len(preview), preview.fps)
player.step({frame})
threading.Thread(target=lambda: (sys.stdin.readline(), stop.set()), daemon=True).start()
print("open", flush=True)
play_native(preview, player=player, stop=stop)
"""


def preview_of_a_throw(folder) -> Preview:
    """An arm that is thrown faster than its servo can."""
    motion, rig = two_arm_motion(seconds=1.0, left=lambda t: 1.5 * np.sin(12 * t)), two_arm_rig(folder)
    return prepare(motion, rig, *judge(motion, rig))


@pytest.fixture(scope="module")
def preview(tmp_path_factory):
    return preview_of_a_throw(tmp_path_factory.mktemp("throw"))


def overlaid(preview: Preview, frame: int) -> list[mujoco.MjvGeom]:
    stage = build_stage(preview.rig, preview.mount)
    data, scene = mujoco.MjData(stage.model), mujoco.MjvScene(stage.model, maxgeom=200)
    stage.place(data, preview.done[frame])
    Overlay(preview, stage).add(scene, data, frame)
    return [scene.geoms[k] for k in range(scene.ngeom)]


def of_colour(geoms: list[mujoco.MjvGeom], colour: tuple[float, ...]) -> list[mujoco.MjvGeom]:
    return [g for g in geoms if np.allclose(g.rgba, colour, atol=1e-3)]


def test_the_ghost_is_where_the_motion_is_and_only_what_is_away_from_it(preview):
    apart = np.abs(preview.asked[:, 7] - preview.done[:, 7])
    geoms = of_colour(overlaid(preview, int(np.argmax(apart))), TARGET)
    angle = preview.asked[np.argmax(apart), 7]
    tip = np.array([0.3 * np.cos(angle), 0.1, 0.93 + 0.3 * np.sin(angle)])  # the arm is 0.3 m and lies level at 0
    assert min(np.linalg.norm(g.pos - tip) for g in geoms) < 1e-5
    assert not any(np.linalg.norm(g.pos - [0, 0, 0.93]) < 0.01 for g in geoms)  # the base is where it should be
    assert of_colour(overlaid(preview, 0), TARGET) == []


@pytest.mark.parametrize(("thrown", "colour"), [(False, INSIDE), (True, OUTSIDE)])
def test_the_zero_moment_point_is_pinned_where_it_is_and_red_outside(preview, tmp_path, thrown, colour):
    motion, rig = two_arm_motion(seconds=0.1), two_arm_rig(tmp_path)
    shown = preview if thrown else prepare(motion, rig, *judge(motion, rig))
    frame = int(np.nanargmin(shown.footing.zmp_margin))
    assert (shown.footing.zmp_margin[frame] >= 0) != thrown
    pins = of_colour(overlaid(shown, frame), colour)
    assert pins
    assert all(np.allclose(g.pos[:2], shown.footing.zmp[frame], atol=1e-5) for g in pins)


def test_the_polygon_is_the_sole(preview):
    lines = of_colour([g for g in overlaid(preview, 0) if g.type == mujoco.mjtGeom.mjGEOM_CAPSULE], EDGE)
    middles = {tuple(np.round(g.pos[:2].astype(float), 3) + 0.0) for g in lines}
    assert middles == {(0.15, 0.0), (-0.15, 0.0), (0.0, 0.15), (0.0, -0.15)}  # of the edges of a sole of 0.3 m


class Window:
    """What `play_native` needs of MuJoCo's viewer; it presses the next key each time that it has drawn."""

    def __init__(self, preview, press, keys) -> None:
        stage = build_stage(preview.rig, preview.mount)
        self.user_scn, self.cam = mujoco.MjvScene(stage.model, maxgeom=200), mujoco.MjvCamera()
        self.press, self.keys, self.texts = press, iter(keys), []

    def lock(self):
        return threading.Lock()

    def is_running(self):
        key = next(self.keys, None)
        if self.texts and key is not None:
            self.press(key)
        return key is not None

    def set_texts(self, texts):
        self.texts.append(texts)

    def sync(self):
        pass


def test_every_key_does_what_the_corner_says(preview, monkeypatch):
    from contextlib import contextmanager

    seen = []
    player = Player(len(preview), preview.fps, clock=lambda: 0.0)  # nothing moves by itself

    @contextmanager
    def opened(stage, data, rows, on_key):
        seen.append(Window(preview, on_key, [0, RIGHT, RIGHT, LEFT, SPACE, ENTER, HOME, 81]))
        yield seen[0]

    monkeypatch.setattr("sim.play_native.opened_window", opened)
    monkeypatch.setattr("sim.play_native.PERIOD", 0.0)
    play_native(preview, player=player)
    said = [dict(zip(t[1][2].split("\n"), t[1][3].split("\n"), strict=True)) for t in seen[0].texts]
    assert [s["time"].split()[0] for s in said] == ["0.00", "0.02", "0.04", "0.02", "0.02", "0.02", "0.00"]
    assert [s[""] for s in said] == [
        "playing, loop", "paused, loop", "paused, loop", "paused, loop", "playing, loop", "playing", "playing"
    ]  # fmt: skip
    assert seen[0].texts[0][0][2].split("\n")[:2] == ["two_arm", "fail"]


def test_the_window_shows_the_rig_the_ghost_and_the_words(tmp_path):
    preview = preview_of_a_throw(tmp_path)
    frame = int(np.argmax(np.abs(preview.asked[:, 7] - preview.done[:, 7])))
    code = WINDOW.format(path=sys.path, folder=str(tmp_path), frame=frame)
    with virtual_display("960x720") as display:
        pipe, env = subprocess.PIPE, {**os.environ, "DISPLAY": display}
        with subprocess.Popen([sys.executable, "-c", code], env=env, stdin=pipe, stdout=pipe, text=True) as shown:
            try:
                assert shown.stdout.readline() == "open\n"
                picture = grab(display, until=lambda screen: blue(screen) > 0.0004)
                shown.communicate("stop\n", timeout=60)
            finally:
                shown.kill()  # nothing, once it has ended
        assert shown.returncode == 0
    assert blue(picture) > 0.0004  # the ghost of the arm
    words = (picture > 200).all(-1)
    assert words[:60, :200].any()
    assert words[360:480, :200].any()


def blue(screen: np.ndarray) -> float:
    """Share of pixels that are much bluer than the floor and the sky."""
    return float((screen[..., 2] > screen[..., 0] + 70).mean())
