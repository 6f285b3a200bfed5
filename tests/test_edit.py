"""`rigcast edit`, and what `say` takes instead of a text: what reaches the generator, and one line for each mistake."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from motions import stand

from motiongen.diffusion.timeline import Entry
from motiongen.diffusion.weights import FOLDER
from motiongen.files import load_motion, save_motion
from motiongen.generator import Familiarity
from motiongen.motion import Motion, Source
from rigcast.__main__ import main


class Recorder:
    """Stands still, and notes what it was asked for."""

    name, licence = "recorder", "CC0"

    def __init__(self) -> None:
        self.asked: list[tuple[str, Any]] = []

    def familiarity(self, text: str) -> Familiarity:
        return Familiarity("stand" in text, 0.9, ("stand",))

    def generate(self, text: str, **how: Any) -> Motion:
        return self._note("text", text, how)

    def generate_action(self, action: str, **how: Any) -> Motion:
        return self._note("action", action, how)

    def generate_unconditioned(self, **how: Any) -> Motion:
        return self._note("nothing", None, how)

    def generate_timeline(self, entries: tuple[Entry, ...], **how: Any) -> Motion:
        return self._note("timeline", entries, how)

    def edit(self, clip: Motion, text: str | None = None, **how: Any) -> Motion:
        return self._note("edit", (len(clip), text), how)

    def _note(self, what: str, said: Any, how: dict[str, Any]) -> Motion:
        self.asked.append((what, said, {k: v for k, v in how.items() if v is not None}))
        return replace(stand(1.0), source=Source(self.name))


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    made = Recorder()
    for verb in ("say", "edit"):
        monkeypatch.setattr(f"rigcast.{verb}.load_generator", lambda name: made)
    return made


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    save_motion(stand(2.0), tmp_path / "clip.npz")
    return tmp_path / "clip.npz"


def test_an_edit_goes_through_the_gate_to_a_file(
    clip: Path, recorder: Recorder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.motion.npz"
    args = ["--keep", "0:1s", "--parts", "left_arm, head", "--text", "nod", "--seed", "7"]
    assert main(["edit", str(clip), *args, "--out", str(out), "--json"]) == 0
    assert recorder.asked == [("edit", (61, "nod"), {"keep": "0:1s", "parts": ["left_arm", "head"], "seed": 7})]
    told = json.loads(capsys.readouterr().out)
    assert told["report"]["ok"]
    assert (told["keep"], told["parts"], told["text"]) == ("0:1s", ["left_arm", "head"], "nod")
    assert len(load_motion(out)) == 31


def test_a_timeline_is_said(recorder: Recorder, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "timeline.txt"
    path.write_text("stand # 0 # 2\nsing # 1 # 2 # head\n")
    assert main(["say", "--timeline", str(path), "--guidance", "2", "--json"]) == 0
    entries = (Entry("stand", 0, 2), Entry("sing", 1, 2, ("head",)))
    assert recorder.asked == [("timeline", entries, {"seed": 0, "guidance": 2.0})]
    told = capsys.readouterr()
    assert "'sing' is far from what" in told.err
    assert json.loads(told.out)["known"] is False
    assert main(["say", "--timeline", str(path), "--strict"]) == 1


def test_an_action_and_nothing_are_said(recorder: Recorder, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["say", "--action", "wave", "--seconds", "2", "--json"]) == 0
    assert main(["say", "--unconditioned", "--seed", "3", "--json"]) == 0
    assert recorder.asked == [("action", "wave", {"seconds": 2.0, "seed": 0}), ("nothing", None, {"seed": 3})]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["say"], "say one thing: a TEXT, --timeline FILE, --action NAME or --unconditioned"),
        (["say", "walk", "--unconditioned"], "say one thing"),
        (["say", "--timeline", "none.txt"], "none.txt: No such file"),
        (["say", "--timeline", "gap.txt"], "nothing is said between 1 and 2 s"),
        (["say", "--timeline", "fine.txt", "--seconds", "3"], "a timeline says itself how long it is"),
        (["say", "--unconditioned", "--seconds", "0"], "between 1 and 60"),
        (["say", "--unconditioned", "--generator", "gestures"], "gestures follows one text only"),
        (["say", "--action", "greet-people"], "no action 'greet-people'; the nearest are "),
        (["edit", "clip.npz"], "nothing says what to draw anew"),
        (["edit", "clip.npz", "--keep", "0:9s"], "outside the clip, which has 61 frames"),
        (["edit", "clip.npz", "--parts", "tail"], "unknown part of the body 'tail'; there are left_arm"),
        (["edit", "clip.npz", "--keep", "0:1s", "--text", " "], "the text is empty"),
        (["edit", "clip.npz", "--keep", "0:1s", "--guidance", "nan"], "guidance must be a number"),
        (["edit", "clip.npz", "--keep", "0:1s", "--generator", "gestures"], "gestures follows one text only"),
        (["edit", "none.bvh", "--keep", "0:1s"], "none.bvh: No such file"),
        (["edit", "fine.txt", "--keep", "0:1s"], "no human motion is read from .txt"),
        (["edit", "clip.npz", "--keep", "0:1s", "--generator", "cut.safetensors"], "cut.safetensors: cut short"),
        (["edit", "clip.npz", "--keep", "0:1s", "--generator", "pickle.safetensors"], "pickle.safetensors: cut short"),
        (["edit", "clip.npz", "--keep", "0:1s", "--generator", "none.safetensors"], "no such weights file"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(
    args: list[str], words: str, clip: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = clip.parent
    monkeypatch.chdir(folder)
    (folder / "gap.txt").write_text("walk # 0 # 1\nbow # 2 # 3\n")
    (folder / "fine.txt").write_text("walk # 0 # 1\n")
    (folder / "cut.safetensors").write_bytes((FOLDER / "mdm.safetensors").read_bytes()[:5000])
    (folder / "pickle.safetensors").write_bytes(b"\x80\x04K\x01.")
    assert main(args) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert said[0].startswith("rigcast: ")
    assert words in said[0]
