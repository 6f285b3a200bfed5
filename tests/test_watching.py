"""What is seen of a training run: lines, the log for TensorBoard, films."""

from dataclasses import replace
from pathlib import Path

import pytest
from motions import walk

from motiongen.diffusion.train import Log
from motiongen.motion import Label
from rigcast.watching import watching

LOG = Log(step=20, steps=80, terms={"total": 0.25, "norm": 1.5}, rate=1e-3, pace=2.0)


def test_a_line_a_log_where_there_is_no_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with watching(tmp_path) as watch:
        watch.say("a line")
        watch.logged(LOG)
    told = capsys.readouterr()
    assert told.out == ""
    lines = told.err.splitlines()
    assert "a line" in lines
    assert lines[-1] == "step 20/80  total 0.2500  norm 1.5000  2.00 s/step, 2 min left"


def test_the_log_is_kept_for_tensorboard(tmp_path: Path) -> None:
    pytest.importorskip("tensorboardX")
    with watching(tmp_path) as watch:
        watch.logged(LOG)
    (file,) = (tmp_path / "log").iterdir()
    assert all(name in file.read_bytes() for name in (b"total", b"norm", b"rate"))


def test_other_processes_show_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RANK", "1")
    with watching(tmp_path) as watch:
        watch.say("a line")
        watch.logged(LOG)
        assert watch.drawn is None
    assert capsys.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


def test_motions_are_filmed(tmp_path: Path) -> None:
    motion = walk(seconds=1)
    motion = replace(motion, labels=(Label(0.0, 0.9, "walk"),))
    with watching(tmp_path) as watch:
        assert watch.drawn
        watch.drawn(200, [motion])
    (film,) = (tmp_path / "samples").iterdir()
    assert film.name == "step-000200-1.mp4"
    assert film.read_bytes()[4:8] == b"ftyp"
    assert film.stat().st_size > 4000
