"""Where the clips of a data set come from: five kinds of source, each a list of clips that are read one by one.

A source is written `KIND:WHERE`; the kind is named, never guessed from what lies in a folder.
"""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np

from motiongen.captions import CONTENTS, kept_for_testing, phrasings, style_name, swap_sides
from motiongen.motion import Motion
from motiongen.reading import read_motion

MOST_CAPTIONS = 24  # a clip, where a grammar could say hundreds
HUMANML3D_LICENCE = "texts MIT (HumanML3D); motions on the terms of AMASS and HumanAct12"
_READABLE = (".bvh", ".npz", ".npy")
_INDEX_COLUMNS = ("Subject", "Trial #", "Motion Description")


class SourceError(ValueError):
    """A source that cannot be used; the message names it and what would do."""


@dataclass(frozen=True)
class Sample:
    """One clip, read: the motion, what it is called, and what its mirror image is called.

    `content` and `style` are empty where the source does not tell them apart.
    """

    motion: Motion
    captions: tuple[str, ...]
    mirrored: tuple[str, ...]
    licence: str
    content: str = ""
    style: str = ""


@dataclass(frozen=True)
class Clip:
    """A clip to be read: `name` is its own within the data set and the same on every machine; `file` as in its source.

    `load` raises ValueError or OSError where the file is bad.
    """

    name: str
    source: str
    file: str
    load: Callable[[], Sample]


def find_clips(spec: str) -> list[Clip]:
    """The clips of the source `spec`, `KIND:WHERE`, in a fixed order, none of them read yet.

    Raises SourceError for an unknown kind, a folder that is missing or holds no clip, and a captions file or index
    that does not fit its folder.
    """
    kind, _, where = spec.partition(":")
    if kind == "gestures":
        return _gestures(where)
    if kind not in _FOLDERS or not where:
        raise SourceError(f"unknown source {spec!r}; there are {_FORMS}")
    find, needs = _FOLDERS[kind]
    folder = Path(where).expanduser()
    if not folder.is_dir():
        raise SourceError(f"{spec}: no such folder")
    clips = find(folder)
    if not clips:
        raise SourceError(f"{spec}: no clips in this folder; {needs}")
    return clips


def split_of(name: str) -> str:
    """ "train" (80 %), "val" (5 %) or "test" (15 %), by the hash of a clip's name: it never changes as clips come.

    Pieces of one clip (`name@start-end`) go together.
    """
    whole = name.partition("@")[0]
    twentieth = int.from_bytes(hashlib.sha256(whole.encode()).digest()[:4], "little") % 20
    return "val" if twentieth == 0 else "test" if twentieth <= 3 else "train"


# ---- The kinds


def _bandai_namco(folder: Path) -> list[Clip]:
    clips = []
    for path in sorted(folder.rglob("dataset-[12]_*_*_*.bvh"), key=lambda p: p.name):
        said = re.fullmatch(r"dataset-\d_(.+)_(.+)_\d+", path.stem)
        if said is None or said[1] not in CONTENTS:
            raise SourceError(f"{path.name}: unknown content; known are {', '.join(CONTENTS)}")
        load = partial(_load_bandai_namco, path, said[1], style_name(said[2]))
        clips.append(Clip(f"bandai-namco/{path.stem}", "bandai-namco", str(path.relative_to(folder)), load))
    return clips


def _load_bandai_namco(path: Path, content: str, style: str) -> Sample:
    motion, name = read_motion(path), f"bandai-namco/{path.stem}"
    # Not the captions with their sides swapped: a plain "wave" means the right hand, also of the mirror image.
    captions, mirrored = (_drawn(phrasings(c, style), name) for c in (content, swap_sides(content)))
    return Sample(motion, captions, mirrored, motion.source.licence, content, style)


def _cmu(folder: Path) -> list[Clip]:
    index = folder / "index.csv"
    if not index.is_file():
        raise SourceError(f"cmu:{folder}: no index.csv with {', '.join(_INDEX_COLUMNS)} in this folder")
    said = {}
    for line, row in _csv_rows(index, _INDEX_COLUMNS):
        subject, trial, words = row
        if not (subject.isdecimal() and trial.isdecimal()):
            raise SourceError(f"{index}: line {line}: subject {subject!r} and trial {trial!r} must be numbers")
        said[int(subject), int(trial)] = words.strip()
    clips = []
    for path in sorted(folder.rglob("*.bvh"), key=lambda p: p.name):
        number = re.fullmatch(r"(\d+)_(\d+)", path.stem)
        words = said.get((int(number[1]), int(number[2])), "") if number else ""
        if words:
            clips.append(
                Clip(f"cmu/{path.stem}", "cmu", str(path.relative_to(folder)), partial(_load_cmu, path, words))
            )
    return clips


def _load_cmu(path: Path, words: str) -> Sample:
    motion = read_motion(path)
    # Frame 0 of these files is a T-pose that is no part of the performance.
    return _said(_cut(motion, 1, len(motion)), (words,), motion.source.licence)


def _folder(folder: Path) -> list[Clip]:
    found = [folder / name for name in ("captions.csv", "captions.jsonl") if (folder / name).is_file()]
    if len(found) != 1:
        have = "both captions.csv and captions.jsonl" if found else "neither captions.csv nor captions.jsonl"
        raise SourceError(f"folder:{folder}: {have} in this folder; one of them must say which file shows what")
    rows = _csv_rows(found[0], ("file", "caption")) if found[0].suffix == ".csv" else _jsonl_rows(found[0])
    captions: dict[str, list[str]] = {}
    for line, (name, caption) in rows:
        if not name.strip() or not caption.strip():
            raise SourceError(f"{found[0]}: line {line}: file {name!r} with caption {caption!r}; neither may be empty")
        if Path(name).suffix not in _READABLE:
            raise SourceError(f"{found[0]}: line {line}: cannot read {name!r}; known are {', '.join(_READABLE)}")
        if not (folder / name).is_file():
            raise SourceError(f"{found[0]}: line {line}: no file {name!r} in {folder}")
        captions.setdefault(name, []).append(caption.strip())
    return [
        Clip(f"{folder.resolve().name}/{name}", "folder", name, partial(_load_file, folder / name, tuple(said)))
        for name, said in sorted(captions.items())
    ]


def _load_file(path: Path, captions: tuple[str, ...]) -> Sample:
    motion = read_motion(path)
    return _said(motion, captions, motion.source.licence or "not stated")


def _humanml3d(folder: Path) -> list[Clip]:
    for needed in ("new_joint_vecs", "texts"):
        if not (folder / needed).is_dir():
            raise SourceError(f"humanml3d:{folder}: no {needed} in this folder; {_FOLDERS['humanml3d'][1]}")
    clips = []
    for path in sorted((folder / "new_joint_vecs").glob("[0-9]*.npy")):  # M… are mirror images: we make our own
        texts = folder / "texts" / f"{path.stem}.txt"
        if not texts.is_file():
            raise SourceError(f"{path}: no {texts}")
        for (start, end), captions in _humanml3d_texts(texts).items():
            name = f"humanml3d/{path.stem}" + (f"@{start:g}-{end:g}" if end else "")
            load = partial(_load_humanml3d, path, start, end, tuple(captions))
            clips.append(Clip(name, "humanml3d", f"new_joint_vecs/{path.name}", load))
    return clips


def _humanml3d_texts(path: Path) -> dict[tuple[float, float], list[str]]:
    """Captions by the seconds that they speak of, (0, 0) for the whole; a line is `caption#tokens#start#end`."""
    out: dict[tuple[float, float], list[str]] = {}
    for line, text in enumerate(_text(path).split("\n"), start=1):
        parts = text.split("#")
        try:
            span = [0.0 if part in ("", "nan") else float(part) for part in parts[2:]]
        except ValueError:
            span = []
        if len(span) != 2 or not parts[0].strip() or not (span == [0, 0] or 0 <= span[0] < span[1]):
            raise SourceError(f"{path}: line {line}: {text!r} is not caption#tokens#start#end")
        out.setdefault((span[0], span[1]), []).append(parts[0].strip())
    return out


def _load_humanml3d(path: Path, start: float, end: float, captions: tuple[str, ...]) -> Sample:
    motion = read_motion(path)
    if end:
        motion = _cut(motion, round(start * motion.fps), round(end * motion.fps) + 1)
    return _said(motion, captions, HUMANML3D_LICENCE)


def _gestures(count: str) -> list[Clip]:
    if not count.isdecimal() or not 0 < int(count) <= 1_000_000:
        raise SourceError(f"gestures:{count}: the count must be from 1 to 1000000")
    return [Clip(f"gestures/{i:06d}", "gestures", "", partial(_load_gesture, i)) for i in range(int(count))]


def _load_gesture(number: int) -> Sample:
    from motiongen.gestures.catalogue import LICENCE, sample

    motion, said = sample(np.random.default_rng(number))  # a clip is the same in every data set, whatever their size
    captions = _drawn(said, f"gestures/{number:06d}")
    family = motion.source.generator.removeprefix("gesture ")
    return Sample(motion, captions, tuple(map(swap_sides, captions)), LICENCE, family)


# What a folder of each kind is read by, and what must lie in it.
_FOLDERS: dict[str, tuple[Callable[[Path], list[Clip]], str]] = {
    "bandai-namco": (_bandai_namco, "it needs files dataset-1_CONTENT_STYLE_NUMBER.bvh"),
    "cmu": (_cmu, "it needs files SUBJECT_TRIAL.bvh that index.csv describes"),
    "humanml3d": (_humanml3d, "it needs new_joint_vecs/NUMBER.npy and texts/NUMBER.txt"),
    "folder": (_folder, "its captions file names none"),
}
_FORMS = ", ".join((*(f"{kind}:FOLDER" for kind in _FOLDERS), "gestures:COUNT"))


# ---- Reading


def _cut(motion: Motion, start: int, end: int) -> Motion:
    contacts = None if motion.contacts is None else motion.contacts[start:end]
    return replace(
        motion, root_pos=motion.root_pos[start:end], joint_quat=motion.joint_quat[start:end], contacts=contacts
    )


def _said(motion: Motion, captions: tuple[str, ...], licence: str) -> Sample:
    return Sample(motion, captions, tuple(map(swap_sides, captions)), licence)


def _drawn(captions: Sequence[str], name: str) -> tuple[str, ...]:
    """At most 24 of a grammar's `captions`, by hash; clips of the training split get none that is kept for testing."""
    if split_of(name) == "train":
        captions = [c for c in captions if not kept_for_testing(c)]
    return tuple(sorted(captions, key=lambda c: hashlib.sha256(f"{name} {c}".encode()).digest())[:MOST_CAPTIONS])


def _csv_rows(path: Path, columns: tuple[str, ...]) -> list[tuple[int, list[str]]]:
    """Line number and the values of `columns` of every row below the header."""
    reader = csv.reader(io.StringIO(_text(path)))
    try:
        (_, header), *found = [(reader.line_num, row) for row in reader] or [(1, [])]
    except csv.Error as error:
        raise SourceError(f"{path}: line {reader.line_num}: {error}") from None
    if missing := [c for c in columns if c not in header]:
        raise SourceError(f"{path}: no column {missing[0]!r} in its first line; it needs {','.join(columns)}")
    for line, row in found:
        if len(row) != len(header):
            what = f"{len(row)} values instead of {len(header)}" if row else "blank"
            raise SourceError(f"{path}: line {line}: {what}")
    return [(line, [row[header.index(c)] for c in columns]) for line, row in found]


class _Caption(msgspec.Struct):
    file: str
    caption: str


def _jsonl_rows(path: Path) -> list[tuple[int, list[str]]]:
    rows = []
    for number, line in enumerate(_text(path).split("\n"), start=1):
        try:
            row = msgspec.json.decode(line, type=_Caption)
        except msgspec.DecodeError as error:
            what = str(error) if line.strip() else "blank"
            raise SourceError(f'{path}: line {number}: {what}; expected {{"file": …, "caption": …}}') from None
        rows.append((number, [row.file, row.caption]))
    return rows


def _text(path: Path) -> str:
    """The file's text without blank lines at its end."""
    try:
        return path.read_text(encoding="utf-8-sig").rstrip("\n")
    except UnicodeDecodeError:
        raise SourceError(f"{path}: not UTF-8 text") from None
