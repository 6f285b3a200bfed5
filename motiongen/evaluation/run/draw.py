"""Draw motions for many texts in chunks that are kept on disk: an interrupted evaluation goes on, a repeated one reads.

A chunk's name is a hash over all that decides what is in it: who draws, the texts, their seconds, seed and candidates.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from itertools import groupby
from pathlib import Path

import msgspec
import numpy as np

from motiongen.candidates import BatchGenerator, choose, choose_from
from motiongen.files import read_kind, write_npz
from motiongen.generator import Generator, PromptError
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source

CHUNK = 32  # motions; what an interruption can lose
Tell = Callable[[int, int], None]


@dataclass(frozen=True)
class Drawing:
    """How motions are drawn: `digest` names the generator in full, weights and code; chunks are kept in `folder`."""

    generator: Generator
    digest: str
    folder: Path
    seed: int
    candidates: int


@dataclass(frozen=True)
class Drawn:
    """A motion a text, None where the generator refused, and for each chunk the seconds of motion that were made in
    how many seconds of computing."""

    motions: tuple[Motion | None, ...]
    pace: tuple[tuple[float, float], ...]


def draw(how: Drawing, texts: Sequence[str], seconds: Sequence[float | None], tell: Tell) -> Drawn:
    """Draw a motion for every text, of its `seconds` or, where None, as long as the generator likes.

    The same arguments give the same motions, in single precision, read from disk where they are there. `tell` is told
    how many are done of how many. Raises ValueError for a motion on another skeleton than SMPL's 22 joints, FileError
    for a damaged chunk.
    """
    order = sorted(range(len(texts)), key=lambda i: seconds[i] or 0.0)  # what is equally long is drawn together
    motions: list[Motion | None] = [None] * len(texts)
    pace = []
    how.folder.mkdir(parents=True, exist_ok=True)
    for start in range(0, len(order), CHUNK):
        at = order[start : start + CHUNK]
        asked = [(texts[i], seconds[i]) for i in at]
        said = (how.digest, how.candidates, how.seed + start * how.candidates, asked)
        path = how.folder / f"{sha256(msgspec.json.encode(said)).hexdigest()[:24]}.npz"
        if not path.is_file():
            began = time.monotonic()
            made = _draw_chunk(how, asked, how.seed + start * how.candidates)
            _save(path, made, time.monotonic() - began)
        there, spent = _load(path, [texts[i] for i in at], how.generator)
        for i, motion in zip(at, there, strict=True):
            motions[i] = motion
        pace.append((sum(m.duration for m in there if m is not None), spent))
        tell(start + len(at), len(texts))
    return Drawn(tuple(motions), tuple(pace))


def _draw_chunk(how: Drawing, asked: Sequence[tuple[str, float | None]], seed: int) -> list[Motion | None]:
    made: list[Motion | None] = []
    for length, group in groupby(asked, key=lambda case: case[1]):
        texts = [text for text, _ in group]
        first = seed + len(made) * how.candidates
        made += _draw_alike(how, texts, length, first)
    return made


def _draw_alike(how: Drawing, texts: list[str], seconds: float | None, seed: int) -> list[Motion | None]:
    """Motions of equal length; text i from `seed` + i candidates further on."""
    if isinstance(how.generator, BatchGenerator):
        seeds = [seed + i * how.candidates for i in range(len(texts))]
        with suppress(PromptError):  # where one of them is refused, one by one tells which
            first = how.generator.generate_batch(texts, seconds=seconds, seed=seeds)
            return [
                choose_from(motion, how.generator, text, candidates=how.candidates, seconds=seconds, seed=each).motion
                for motion, text, each in zip(first, texts, seeds, strict=True)
            ]
    return [_draw_one(how, text, seconds, seed + i * how.candidates) for i, text in enumerate(texts)]


def _draw_one(how: Drawing, text: str, seconds: float | None, seed: int) -> Motion | None:
    """A motion of `seconds`; where that is refused, as long as the generator likes: the length was not the text's."""
    for length in dict.fromkeys((seconds, None)):
        with suppress(PromptError):
            return choose(how.generator, text, candidates=how.candidates, seconds=length, seed=seed).motion
    return None


def _save(path: Path, motions: Sequence[Motion | None], spent: float) -> None:
    there = [m for m in motions if m is not None]
    for motion in there:
        if motion.skeleton.names != SMPL_JOINTS:
            raise ValueError(
                f"a motion of {len(motion.skeleton.names)} joints; it needs the {len(SMPL_JOINTS)} of SMPL"
            )
    joints = len(SMPL_JOINTS)
    arrays = {
        "frames": np.array([0 if m is None else len(m) for m in motions]),
        "fps": np.array([0.0 if m is None else m.fps for m in motions]),
        "spent": spent,
        "offsets": np.array([m.skeleton.offsets for m in there], np.float32).reshape(-1, joints, 3),
        "foot_height": np.array([m.skeleton.foot_height for m in there]).reshape(-1, 2),
        "root_pos": np.concatenate([np.zeros((0, 3)), *(m.root_pos for m in there)]).astype(np.float32),
        "joint_quat": np.concatenate([np.zeros((0, joints, 4)), *(m.joint_quat for m in there)]).astype(np.float32),
    }
    write_npz(path, "drawn", arrays)


def _load(path: Path, texts: Sequence[str], generator: Generator) -> tuple[list[Motion | None], float]:
    arrays = read_kind(path, "drawn")
    motions: list[Motion | None] = []
    row = body = 0
    for text, frames, fps in zip(texts, arrays["frames"], arrays["fps"], strict=True):
        if frames == 0:
            motions.append(None)
            continue
        skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, arrays["offsets"][body], tuple(arrays["foot_height"][body]))
        root, quat = (arrays[name][row : row + frames] for name in ("root_pos", "joint_quat"))
        label = Label(0.0, float((frames - 1) / fps), text)
        source = Source(generator.name, licence=generator.licence)
        motions.append(Motion(root, quat, float(fps), skeleton, (label,), source))
        row, body = row + int(frames), body + 1
    return motions, float(arrays["spent"])
