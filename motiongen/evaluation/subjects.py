"""What can be evaluated: generators, weights files, baselines, held-out clips, noise, anybody's motion files."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from motiongen.data.dataset import Dataset
from motiongen.data.sources import SourceError, find_clips
from motiongen.evaluation.judges.sanity import noise
from motiongen.evaluation.protocol import Clips
from motiongen.evaluation.run.results import file_digest
from motiongen.features import FPS
from motiongen.generator import Familiarity, Generator, PromptError, check_prompt, list_generators, load_generator
from motiongen.motion import Motion
from motiongen.smpl import SMPL_SKELETON

BASELINES = ("retrieval", "mean-pose", "noise")
REAL = "real"
_CODE = Path(__file__).parent.parent
_NOT_DRAWING = {"data", "evaluation"}  # of the package, what never changes a motion: the clips, and how it is judged


@dataclass(frozen=True)
class Opened:
    """A thing to evaluate: a `generator`, or the `clips` of a folder, or, with neither, held-out clips.

    `digest` names weights, code and files in full; `passes`: denoising passes of a diffusion model, or None.
    """

    name: str
    digest: str
    licence: str
    generator: Generator | None = None
    clips: Clips | None = None
    passes: int | None = None


def open_subject(what: str, data: Dataset) -> Opened:
    """Open a generator's name, `retrieval`, `mean-pose`, `noise`, `real`, a `.safetensors` file of weights, or a folder
    of motion files with a captions file.

    Raises PromptError for another name, SourceError for a folder that cannot be used, or a motion in it that cannot be
    read or is on another skeleton, WeightsError for weights.
    """
    if what == REAL:
        return Opened(REAL, data_digest(data), "; ".join(sorted({e.licence for e in data.entries})))
    if what in BASELINES:
        baseline = _baseline(what, data)
        return Opened(what, f"{code_digest()} {data_digest(data)}", baseline.licence, baseline)
    if what in list_generators():
        return _of_generator(what, load_generator(what))
    path = Path(what)
    if path.suffix == ".safetensors":
        return _of_generator(path.stem, load_generator(what))
    if not path.is_dir():
        names = ", ".join((*list_generators(), *BASELINES, REAL))
        raise PromptError(f"no subject {what!r}; there are {names}, a .safetensors file, or a folder with captions.csv")
    return _of_folder(path)


def _of_generator(name: str, generator: Generator) -> Opened:
    digest, passes = getattr(generator, "digest", ""), getattr(generator, "passes", None)  # what only a model has
    return Opened(name, f"{code_digest()} {digest}".strip(), generator.licence, generator, passes=passes)


def _baseline(name: str, data: Dataset) -> Generator:
    if name == "noise":
        return Noise()
    from motiongen.evaluation.baselines import MeanPose, Retrieval

    return Retrieval(data) if name == "retrieval" else MeanPose(data)


def _of_folder(folder: Path) -> Opened:
    motions: list[Motion] = []
    captions: list[str] = []
    licences: set[str] = set()
    files = find_clips(f"folder:{folder}")
    for file in files:
        try:
            sample = file.load()
            Clips((sample.motion,), ("what it shows",))  # its skeleton is checked while the file's name is known
        except ValueError as error:
            raise SourceError(f"{folder / file.file}: {error}") from None
        motions += [sample.motion] * len(sample.captions)
        captions += sample.captions
        licences.add(sample.licence)
    digest = sha256("".join(file_digest(folder / file.file) for file in files).encode()).hexdigest()[:16]
    clips = Clips(tuple(motions), tuple(captions))
    return Opened(folder.resolve().name, digest, "; ".join(sorted(licences)), clips=clips)


class Noise:
    """Independent random numbers in every frame, whatever the text says."""

    name = "noise"
    licence = "none"

    def familiarity(self, text: str) -> Familiarity:
        """Nothing is ever known; raises PromptError for a text that nobody could follow."""
        check_prompt(text)
        return Familiarity(False, 0.0, ())

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """Noise for `seconds`, or 4; `guidance` changes nothing. Raises PromptError."""
        check_prompt(text, seconds)
        return noise([_still(seconds or 4.0)], seed)[0]


def _still(seconds: float) -> Motion:
    frames = round(seconds * FPS) + 1
    quat = np.zeros((frames, len(SMPL_SKELETON.names), 4))
    quat[..., 0] = 1.0
    return Motion(np.zeros((frames, 3)), quat, FPS, SMPL_SKELETON)


def code_digest() -> str:
    """16 hex digits over the code that motions come from."""
    files = [p for p in sorted(_CODE.rglob("*.py")) if p.relative_to(_CODE).parts[0] not in _NOT_DRAWING]
    return sha256("".join(file_digest(path) for path in files).encode()).hexdigest()[:16]


def data_digest(data: Dataset) -> str:
    """16 hex digits over what clips a data set has, how they are called and split."""
    files = sorted(data.folder.glob("shard-*.jsonl"))
    return sha256("".join(file_digest(path) for path in files).encode()).hexdigest()[:16]
