"""Those who judge: two evaluators, a classifier of contents, one of styles; trained on first use, then kept."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import msgspec
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from motiongen.data.dataset import Dataset
from motiongen.evaluation.judges.contents import Contents, clips_of, judged_contents, train_contents
from motiongen.evaluation.judges.judge import Judge, JudgeError, Kind, load_judge
from motiongen.evaluation.judges.train import JUDGE, TrainConfig, train
from motiongen.evaluation.language.discriminants import STYLED, style_judge
from motiongen.evaluation.language.prompts import STYLES, family
from motiongen.evaluation.language.run import Judge as Namer
from motiongen.evaluation.run.results import file_digest
from motiongen.evaluation.run.sets import Plan
from motiongen.files import replacing
from motiongen.motion import Motion

CONTENTS = "contents.safetensors"
_FORMAT = "rigcast-contents-1"


@dataclass(frozen=True)
class Judges:
    """Who judges. `contents` and `style` are None where the data set does not tell them apart; `real_contents`: the
    classifier's right answers on held-out clips, and how many those are, by content; `digests`: of files, by name."""

    evaluators: tuple[Judge, ...]
    contents: Contents | None
    style: Namer | None
    real_contents: dict[str, tuple[int, int]]
    digests: dict[str, str]

    def content(self, motions: list[Motion]) -> list[str]:
        """The content that each motion shows, as far as the classifier can tell; "" where there is none."""
        if self.contents is None:
            return [""] * len(motions)
        return self.contents.judge_motions(motions)


def open_judges(data: Dataset, folder: Path, plan: Plan, say: Callable[[str], None]) -> Judges:
    """Read the judges in `folder`, and train there on the data set's training clips those that are missing or had fewer
    steps than the plan has. An interrupted training goes on from its checkpoint.

    `say` is told what is done. Raises JudgeError for a damaged file, ValueError where the data set has too few clips.
    """
    evaluators = []
    for kind in get_args(Kind):
        path = folder / kind / JUDGE
        judge = load_judge(path) if path.is_file() else None
        if judge is None or judge.about.steps < plan.judge_steps[kind]:
            say(f"training the evaluator {kind}")
            with redirect_stdout(sys.stderr):
                judge = train(data, folder / kind, TrainConfig(kind=kind, steps=plan.judge_steps[kind]))
        evaluators.append(judge)
    classifier = _classifier(data, folder / CONTENTS, plan, say)
    say("judging held-out clips")
    digests: dict[str, str] = {judge.name: file_digest(folder / judge.about.kind / JUDGE) for judge in evaluators}
    if classifier is None:
        return Judges(tuple(evaluators), None, None, {}, digests)
    digests["contents"] = file_digest(folder / CONTENTS)
    return Judges(tuple(evaluators), classifier, _styles(data), _on_real(data, classifier), digests)


def _classifier(data: Dataset, path: Path, plan: Plan, say: Callable[[str], None]) -> Contents | None:
    """The classifier at `path`, trained where need be; None for a data set with fewer than two contents."""
    contents = judged_contents(data)
    if len(contents) < 2:
        return None
    if not path.is_file() or _steps(path) < plan.content_steps:
        say("training the classifier of contents")
        _save(train_contents(data, contents, steps=plan.content_steps), plan.content_steps, path)
    return load_contents(path)


def _styles(data: Dataset) -> Namer | None:
    styled = {e.style for e in data.entries if family(e.content) in STYLED and e.style in STYLES}
    return style_judge(data) if len(styled) > 1 else None


def _on_real(data: Dataset, classifier: Contents) -> dict[str, tuple[int, int]]:
    """Right answers, and clips, of each content."""
    rows = clips_of(data, classifier.contents, "test")
    found = {c: classifier.judge([data.features(*row) for row in each]) for c, each in rows.items() if each}
    return {content: (said.count(content), len(said)) for content, said in found.items()}


def _save(classifier: Contents, steps: int, path: Path) -> None:
    metadata = {
        "format": _FORMAT,
        "contents": msgspec.json.encode(classifier.contents).decode(),
        "steps": str(steps),
    }
    with replacing(path) as temporary:
        save_file({k: v.contiguous() for k, v in classifier.state_dict().items()}, temporary, metadata=metadata)
        temporary.chmod(0o644)  # safetensors makes files that only their owner can read


def _steps(path: Path) -> int:
    return int(_read(path)[0]["steps"])


def load_contents(path: Path) -> Contents:
    """The classifier of contents in `path`. Raises JudgeError for a damaged file, or one of another project."""
    metadata, tensors = _read(path)
    classifier = Contents(msgspec.json.decode(metadata["contents"], type=list[str]), tensors["offsets"])
    classifier.load_state_dict(tensors)
    return classifier.eval()


def _read(path: Path) -> tuple[dict[str, str], dict[str, torch.Tensor]]:
    try:
        with safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            tensors = {k: file.get_tensor(k) for k in file.keys()}  # noqa: SIM118 (not a dict)
    except SafetensorError as error:
        raise JudgeError(f"{path}: damaged ({error})") from None
    if metadata.get("format") != _FORMAT:
        raise JudgeError(f"{path}: not a classifier of contents of this project ({_FORMAT})")
    return metadata, tensors
