"""Pictures of the previews in the docs, from real runs: the window, the page in the browser, the report.

    python benchmarks/screenshots.py docs/media
    python benchmarks/screenshots.py docs/media --only page

The window needs Xvfb, the others Chromium, as `chromium` on the path or named by CHROMIUM.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from browser import browser, chromium
from displays import grab, virtual_display
from PIL import Image

from rigcast.__main__ import main as rigcast

FALL = ["say", "walk forward", "--mount", "free", "--no-fix", "--unchecked"]  # it falls, which is what a report is for
FALLING_S = 0.6
STEP = ["say", "take a step forward", "--mount", "free", "--view", "web"]
THEN = "bow deeply"
MOST_BYTES = 150_000  # all of them
QUALITY = 62  # of WebP


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", choices=PICTURES, help="one of them")
    args = parser.parse_args()
    for name in [args.only] if args.only else PICTURES:
        taken, width = PICTURES[name]
        picture = taken()
        picture.thumbnail((width, picture.height))
        picture.save(args.folder / f"preview-{name}.webp", quality=QUALITY, method=6)
    size = 0
    for path in sorted(args.folder.glob("preview-*.webp")):
        size += path.stat().st_size
        print(f"{path}: {path.stat().st_size / 1000:.0f} KB")
    print(f"{size / 1000:.0f} KB together (at most {MOST_BYTES / 1000:.0f})")
    return 0 if size <= MOST_BYTES else 1


def window() -> Image.Image:
    """The window, at a moment of the fall."""
    with tempfile.TemporaryDirectory() as scratch, virtual_display("1080x780") as display:
        trajectory = Path(scratch) / "fall.npz"
        rigcast([*FALL, "--out", str(trajectory)])
        shown = get_context("spawn").Process(target=show_window, args=(display, trajectory, FALLING_S))
        shown.start()
        screen = grab(display, until=lambda seen: (seen[..., 2] > seen[..., 0] + 70).mean() > 0.01)  # the blue ghost
        shown.terminate()
        shown.join()
    filled = np.nonzero(screen.max(-1) > 30)
    return Image.fromarray(screen.astype(np.uint8)).crop((0, 0, int(filled[1].max()) + 1, int(filled[0].max()) + 1))


def show_window(display: str, trajectory: Path, at_s: float) -> None:
    """`rigcast play --view native` on a display, paused at a moment."""
    os.environ["DISPLAY"] = display
    from retarget.files import load_trajectory
    from retarget.rig import load_rig
    from rigcast.outputs import preview_of
    from rigcast.pipeline import take
    from rigcast.times import Times
    from sim.play_native import play_native
    from sim.player import Player

    what = load_trajectory(trajectory)
    preview = preview_of(take(what, load_rig(what.rig), "free", Times()))
    player = Player(len(preview), preview.fps)
    player.hold(preview.frame_at(at_s))
    play_native(preview, player=player)


def page() -> Image.Image:
    """The page in the browser, where after one thing another was said."""
    command = [sys.executable, "-m", "rigcast", *STEP]
    with (
        subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as said,
        browser(_browser(), (1280, 760)) as tab,
    ):
        try:
            address = next(found[1] for line in said.stderr or () if (found := re.search(r"open (\S+) in", line)))
            tab.open(address)
            tab.wait("Timeline")
            tab.wait("Software WebGL")
            tab.click("document.querySelector('.mantine-Notification-closeButton')")
            tab.click("document.querySelector('form input')")
            tab.type(THEN)
            tab.press("Enter", 13)
            tab.wait(f"done {THEN}")
            tab.click("document.querySelector('.mantine-Slider-track')")  # the middle of the bow, and it pauses there
            tab.wait("play")
            time.sleep(1)
            return tab.picture()
        finally:
            said.send_signal(signal.SIGINT)


def report() -> Image.Image:
    """The upper part of the report on the fall."""
    with tempfile.TemporaryDirectory() as scratch, browser(_browser(), (1100, 2100)) as tab:
        html = Path(scratch) / "report.html"
        rigcast([*FALL, "--out", str(html)])
        tab.open(html.as_uri())
        tab.wait("Joints")
        return tab.picture()


def _browser() -> str:
    program = chromium()
    if program is None:
        raise SystemExit("no Chromium on the path; name one by CHROMIUM")
    return program


PICTURES = {"window": (window, 660), "page": (page, 1000), "report": (report, 640)}  # and their widths in the docs

if __name__ == "__main__":
    sys.exit(main())
