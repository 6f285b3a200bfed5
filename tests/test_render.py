"""Films and sheets decode, have the right size and length, and show the rig that moves."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image
from two_arm_rig import two_arm_motion as motion
from two_arm_rig import two_arm_rig as make_rig

from sim.look import build_stage, follow
from sim.render import render_sheet, render_video

SIZE = (160, 120)
CLIP = motion(seconds=0.98, fps=50, left=lambda t: 1.2 * np.sin(4 * t))  # 50 rows, one second


def film(path: Path) -> tuple[str, np.ndarray]:
    """What ffmpeg says about a film, and its frames (T, height, width, 3)."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    return done.stderr.decode(), np.frombuffer(done.stdout, np.uint8).reshape(-1, SIZE[1], SIZE[0], 3)


def moves(frames: np.ndarray) -> bool:
    """Some pixels change by much over time, and most do not change at all."""
    change = np.ptp(frames.astype(int), axis=0).max(-1)
    return bool((change > 60).mean() > 0.001 and (change < 25).mean() > 0.7)


def test_an_mp4_is_h264_for_browsers_with_the_clip_s_length(tmp_path):
    count = render_video(CLIP.qpos, CLIP.fps, make_rig(tmp_path), tmp_path / "a.mp4", size=SIZE, title="one")
    about, frames = film(tmp_path / "a.mp4")
    assert count == 25
    assert frames.shape == (25, 120, 160, 3)
    assert re.search(r"Video: h264.*yuv420p.*160x120.* 25 fps", about)
    assert "Duration: 00:00:01.00" in about
    assert frames.std() > 15
    assert moves(frames)


def test_half_speed_is_twice_as_long(tmp_path):
    assert render_video(CLIP.qpos, CLIP.fps, make_rig(tmp_path), tmp_path / "a.mp4", size=SIZE, speed=0.5) == 50
    about, frames = film(tmp_path / "a.mp4")
    assert len(frames) == 50
    assert "Duration: 00:00:02.00" in about


def test_a_gif_loops_in_real_time(tmp_path):
    assert render_video(CLIP.qpos, CLIP.fps, make_rig(tmp_path), tmp_path / "a.gif", size=SIZE) == 20
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.size == SIZE
        assert gif.info["loop"] == 0
        frames, took = [], 0
        for i in range(gif.n_frames):
            gif.seek(i)
            frames.append(np.asarray(gif.convert("RGB")))
            took += gif.info["duration"]
    assert took == 1000
    assert moves(np.stack(frames))


def test_a_sheet_has_a_panel_for_each_pose(tmp_path):
    render_sheet(CLIP.qpos, CLIP.fps, make_rig(tmp_path), tmp_path / "a.png", panels=5, columns=3, size=SIZE, title="x")
    with Image.open(tmp_path / "a.png") as sheet:
        pixels = np.asarray(sheet).astype(int)
    assert pixels.shape == (40 + 2 * SIZE[1], 3 * SIZE[0], 3)
    panels = [pixels[40 + r * 120 : 160 + r * 120, c * 160 : 160 + c * 160] for r in range(2) for c in range(3)]
    assert all(p.std() > 15 for p in panels[:5])
    assert (panels[5] == 255).all()
    assert np.abs(panels[0] - panels[2])[30:].max() > 60  # below the time that is written in it


def test_the_rig_stays_in_the_picture_however_far_it_goes(tmp_path):
    rig = make_rig(tmp_path)
    walk = motion(seconds=2, root=lambda t: 3.0 * t[:, None] * np.array([1.0, 0.5, 0.0]))
    for row, camera in zip(walk.qpos, follow(walk.qpos, walk.fps, build_stage(rig)), strict=True):
        assert np.hypot(*(camera.lookat[:2] - row[:2])) < 1.0
    standing = follow(motion().qpos, 50, build_stage(rig))
    assert {tuple(c.lookat) for c in standing} == {tuple(standing[0].lookat)}


@pytest.mark.parametrize(
    ("name", "more", "message"),
    [
        ("a.avi", {}, "suffix must be .mp4 or .gif"),
        ("a.mp4", {"size": (161, 120)}, "even numbers"),
        ("a.mp4", {"speed": 0.0}, "must be above 0, not 50 and 0.0"),
    ],
)
def test_what_cannot_be_filmed_is_refused(tmp_path, name, more, message):
    with pytest.raises(ValueError, match=message):
        render_video(CLIP.qpos, CLIP.fps, make_rig(tmp_path), tmp_path / name, **more)
    with pytest.raises(ValueError, match=r"suffix must be \.png"):
        render_sheet(CLIP.qpos, CLIP.fps, make_rig(tmp_path), tmp_path / "a.jpg")
    assert [p.name for p in tmp_path.iterdir()] == ["model.xml"]


def test_a_film_that_fails_leaves_the_old_one(tmp_path):
    (tmp_path / "a.mp4").write_text("old")
    wrong = np.full_like(CLIP.qpos, np.nan)[:, :-1]  # a joint is missing
    with pytest.raises(ValueError, match="could not broadcast"):
        render_video(wrong, 50, make_rig(tmp_path), tmp_path / "a.mp4", size=SIZE)
    assert (tmp_path / "a.mp4").read_text() == "old"
    assert {p.name for p in tmp_path.iterdir()} == {"a.mp4", "model.xml"}


@pytest.mark.parametrize("backend", ["", "osmesa"])
def test_drawing_needs_no_screen_even_when_mujoco_is_already_imported(tmp_path, backend):
    code = f"""
import mujoco, sys
from pathlib import Path
sys.path.insert(0, {os.path.dirname(__file__)!r})
from two_arm_rig import two_arm_motion, two_arm_rig
from sim.render import render_sheet
clip = two_arm_motion(seconds=0.1)
render_sheet(clip.qpos, clip.fps, two_arm_rig(Path({str(tmp_path)!r})), Path({str(tmp_path)!r}) / "a.png", panels=1)
"""
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "PYOPENGL_PLATFORM")}
    done = subprocess.run(
        [sys.executable, "-c", code], env={**env, "MUJOCO_GL": backend}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert np.asarray(Image.open(tmp_path / "a.png")).std() > 15
