"""The picture of a report in the docs, from a real run: generate, judge, write the page, photograph it in a browser.

    python benchmarks/screenshots.py docs/media

It needs Chromium, as `chromium` on the path or named by CHROMIUM.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from rigcast.__main__ import main as rigcast

SAY = ["say", "walk forward", "--mount", "free", "--no-fix", "--unchecked"]  # it falls, which is what a report is for
SIZE = (1100, 2200)
WIDTH = 640  # pixels of the picture in the docs
MOST_BYTES = 150_000
QUALITY = 74


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    browser = os.environ.get("CHROMIUM") or shutil.which("chromium")
    if browser is None:
        print("no Chromium on the path; name one by CHROMIUM", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as scratch:
        page, shot = Path(scratch) / "report.html", Path(scratch) / "shot.png"
        if code := rigcast([*SAY, "--out", str(page)]):
            return code
        photograph(browser, page.as_uri(), shot)
        picture = Image.open(shot).convert("RGB")
    picture.thumbnail((WIDTH, picture.height))
    out = folder / "report-page.jpg"
    picture.save(out, quality=QUALITY, optimize=True)
    size = out.stat().st_size
    print(f"{out}: {picture.width} x {picture.height}, {size / 1000:.0f} KB (at most {MOST_BYTES / 1000:.0f})")
    return 0 if size <= MOST_BYTES else 1


def photograph(browser: str, address: str, path: Path) -> None:
    """Write what `browser` shows at `address`, from its top, as a .png. Raises CalledProcessError."""
    flags = ["--headless", "--disable-gpu", "--hide-scrollbars", f"--window-size={SIZE[0]},{SIZE[1]}"]
    if os.geteuid() == 0:
        flags.append("--no-sandbox")  # Chromium has none for root
    subprocess.run([browser, *flags, f"--screenshot={path}", address], check=True, capture_output=True)


if __name__ == "__main__":
    sys.exit(main())
