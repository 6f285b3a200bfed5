"""What several test modules share."""

from __future__ import annotations

from pathlib import Path

import pytest
from motions import walk, wave

from motiongen.files import save_motion
from motiongen.formats.bvh_write import write_bvh


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two clips with three captions."""
    where = tmp_path / "clips"
    (where / "more").mkdir(parents=True)
    save_motion(wave("right"), where / "wave.npz")
    write_bvh(walk(), where / "more" / "walk.bvh")
    (where / "captions.csv").write_text(
        'file,caption\nwave.npz,"waves, upright, with the right hand"\nmore/walk.bvh,walks\nwave.npz,"says ""hi"""\n'
    )
    return where
