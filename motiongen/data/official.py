"""The official directories of HumanML3D and KIT-ML: `new_joint_vecs/`, `texts/`, and lists of the splits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from motiongen.data.clip import SPLITS, Clip, Sample, SourceError, stamp, told
from motiongen.data.tables import text_of
from motiongen.formats.reading import read_motion
from motiongen.motion import cut


@dataclass(frozen=True)
class Layout:
    """One of the two data sets: its kind of source, how wide its features are, and on what terms they come."""

    kind: str
    width: int
    licence: str


HUMANML3D = Layout("humanml3d", 263, "texts MIT (HumanML3D); motions on the terms of AMASS and HumanAct12")
KIT_ML = Layout("kit-ml", 251, "KIT Motion-Language Dataset; motions on the terms of the KIT motion database and CMU")


def official_clips(layout: Layout, folder: Path) -> list[Clip]:
    """The clips of an official directory, those of the mirror images (M…) left out: we make our own.

    Where `train.txt`, `val.txt` and `test.txt` are there, they say the splits, and a clip in none of them is left out.
    A text that speaks of some seconds makes a clip of its own. Raises SourceError for what is missing or bad.
    """
    for needed in ("new_joint_vecs", "texts"):
        if not (folder / needed).is_dir():
            raise SourceError(
                f"{layout.kind}:{folder}: no {needed} in this folder; "
                "it needs new_joint_vecs/NUMBER.npy and texts/NUMBER.txt"
            )
    splits = _splits(folder)
    clips = []
    for path in sorted((folder / "new_joint_vecs").glob("[0-9]*.npy")):
        if splits and path.stem not in splits:
            continue
        texts = folder / "texts" / f"{path.stem}.txt"
        if not texts.is_file():
            raise SourceError(f"{path}: no {texts}")
        for (start, end), captions in _texts(texts).items():
            name = f"{layout.kind}/{path.stem}" + (f"@{start:g}-{end:g}" if end else "")
            load = partial(_load, layout, path, start, end, tuple(captions), name)
            file, split = f"new_joint_vecs/{path.name}", splits.get(path.stem, "")
            clips.append(Clip(name, layout.kind, file, load, stamp(path, captions), split))
    return clips


def _splits(folder: Path) -> dict[str, str]:
    """The split of each clip that the official lists name; empty where there are no lists."""
    lists = {split: folder / f"{split}.txt" for split in SPLITS}
    there = [split for split in SPLITS if lists[split].is_file()]
    if not there:
        return {}
    if missing := [split for split in SPLITS if split not in there]:
        raise SourceError(f"{folder}: has {there[0]}.txt but no {missing[0]}.txt; all three or none say the splits")
    out: dict[str, str] = {}
    for split, path in lists.items():
        for line, name in enumerate(text_of(path).split(), start=1):
            if out.setdefault(name, split) != split:
                raise SourceError(f"{path}: line {line}: {name} is in {out[name]}.txt too")
    return out


def _texts(path: Path) -> dict[tuple[float, float], list[str]]:
    """Captions by the seconds that they speak of, (0, 0) for the whole; a line is `caption#tokens#start#end`."""
    out: dict[tuple[float, float], list[str]] = {}
    for line, text in enumerate(text_of(path).split("\n"), start=1):
        parts = text.split("#")
        try:
            span = [0.0 if part in ("", "nan") else float(part) for part in parts[2:]]
        except ValueError:
            span = []
        if len(span) != 2 or not parts[0].strip() or not (span == [0, 0] or 0 <= span[0] < span[1]):
            raise SourceError(f"{path}: line {line}: {text!r} is not caption#tokens#start#end")
        out.setdefault((span[0], span[1]), []).append(parts[0].strip())
    return out


def _load(layout: Layout, path: Path, start: float, end: float, captions: tuple[str, ...], name: str) -> Sample:
    require_width(path, layout)
    motion = read_motion(path)
    if end:
        motion = cut(motion, round(start * motion.fps), round(end * motion.fps) + 1)
    return told(motion, captions, name, layout.licence)


def require_width(path: Path, layout: Layout) -> None:
    """Raise ValueError where a file's features are not those of the data set that it is said to be from."""
    import numpy as np

    shape = np.load(path, mmap_mode="r", allow_pickle=False).shape
    if shape[1:] != (layout.width,):
        raise ValueError(f"{path}: {shape} is not (frames, {layout.width}), the features of {layout.kind}")
