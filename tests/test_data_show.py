"""Data sets: what is told of them, and drawn."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from motiongen.data.build import build
from motiongen.data.dataset import Entry
from motiongen.data.pictures import CELL, LEFT, POSES, RIGHT, TITLE, different, draw_clips
from rigcast.__main__ import main


def test_a_data_set_without_pillow_has_no_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert build(["gestures:1"], tmp_path / "out")[1]
    assert "report.png" not in (tmp_path / "out" / "report.md").read_text()
    assert not (tmp_path / "out" / "report.png").exists()


def test_stick_figures_stand_where_the_joints_are(folder: Path, tmp_path: Path) -> None:
    """The hand that waves is high, on the picture's left and blue: it is the right one, seen from ahead."""
    from PIL import Image

    dataset, _ = build([f"folder:{folder}"], tmp_path / "out")
    draw_clips(dataset, [1], tmp_path / "clip.png")
    with Image.open(tmp_path / "clip.png") as picture:
        rgb = np.asarray(picture.convert("RGB")).astype(int)
    middle = slice(4 * CELL[0], 5 * CELL[0])
    assert rgb.shape == (CELL[1] + TITLE, POSES * CELL[0], 3)

    def highest(colour: tuple[int, int, int]) -> tuple[int, int]:
        rows, columns = np.nonzero((np.abs(rgb[TITLE:, middle] - colour) < 12).all(-1))
        return int(rows.min()), int(columns[rows.argmin()])

    (blue, across), (red, _) = highest(RIGHT), highest(LEFT)
    assert blue < red - 10
    assert across < CELL[0] / 2 - 10


def test_different_contents_are_picked() -> None:
    content = [("a", ""), ("b", ""), ("a", ""), ("c", ""), ("d", ""), ("b", "")]
    entries = [Entry(str(i), "", "", "", "train", 0, 1, (), (), c, s, (), (0, 0)) for i, (c, s) in enumerate(content)]
    assert different(entries, 2) == [0, 4]
    assert different(entries, 9) == [0, 1, 3, 4]
    assert different([replace(e, content="") for e in entries], 3) == [0, 2, 5]


def test_show_lists_tells_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from PIL import Image

    dataset, _ = build(["gestures:22"], tmp_path / "out")
    assert main(["data", "show", str(tmp_path / "out")]) == 0
    listed = capsys.readouterr().out
    assert "gestures/000019" in listed
    assert "… and 2 more" in listed
    shortest = min(range(len(dataset)), key=lambda i: dataset.entries[i].frames)
    sheet = tmp_path / "sheet.png"
    args = ["data", "show", str(tmp_path / "out"), "--clip", str(shortest), "--mirrored", "--out", str(sheet)]
    assert main(args) == 0
    assert all(caption in capsys.readouterr().out.splitlines()[1] for caption in dataset.captions(shortest, True)[:1])
    with Image.open(sheet) as picture:
        assert picture.size == (1280, 680)


def test_a_sheet_has_a_row_a_clip(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from PIL import Image

    dataset, _ = build(["gestures:3"], tmp_path / "out")
    sheet = tmp_path / "sheet.png"
    assert main(["data", "show", str(tmp_path / "out"), "--sheet", "2", "--out", str(sheet)]) == 0
    assert capsys.readouterr().out.splitlines() == [f"{i}: {dataset.captions(i)[0]}" for i in (0, 2)]
    with Image.open(sheet) as picture:
        assert picture.size == (896, 328)
        pixels = np.asarray(picture.convert("L")).astype(int)
    panels = pixels[24:164].reshape(140, 7, 128)
    assert np.abs(panels[:, 0] - panels[:, 3]).max() > 30  # something moves
