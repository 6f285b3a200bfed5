"""Where the clips of a data set come from: kinds of source, each a list of clips that are read one by one.

A source is written `KIND:WHERE`; the kind is named, never guessed from what lies in a folder.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from motiongen.data.clip import Clip, Sample, SourceError, drawn, stamp, told
from motiongen.data.composed import composed_clips
from motiongen.data.official import HUMANML3D, KIT_ML, official_clips
from motiongen.data.tables import csv_rows, jsonl_rows
from motiongen.formats.reading import MOTION_FILES, read_motion
from motiongen.measure.clip import measure, mirrored
from motiongen.motion import cut
from motiongen.text.captions import CONTENTS, phrasings, style_name, swap_sides

_INDEX_COLUMNS = ("Subject", "Trial #", "Motion Description")
_MOST = 1_000_000


def find_all(specs: Sequence[str]) -> list[Clip]:
    """The clips of all the sources `specs`, in a fixed order, those composed of others last; raises SourceError as
    `find_clips` does.

    So too where a clip is in them twice, or none is named.
    """
    if not specs:
        raise SourceError("no source; name one or more, for example gestures:100 or folder:FOLDER")
    made_of_others = [spec for spec in specs if spec.partition(":")[0] == "composed"]
    clips = [clip for spec in specs if spec not in made_of_others for clip in find_clips(spec)]
    clips += [clip for spec in made_of_others for clip in composed_clips(_count(spec), clips)]
    name, times = Counter(clip.name for clip in clips).most_common(1)[0]
    if times > 1:
        raise SourceError(f"clip {name} is in the sources {times} times")
    return clips


def absolute(spec: str) -> str:
    """`spec` with the whole path of its folder, where it has one."""
    kind, _, where = spec.partition(":")
    return f"{kind}:{Path(where).expanduser().resolve()}" if kind in _FOLDERS else spec


def find_clips(spec: str) -> list[Clip]:
    """The clips of the source `spec`, `KIND:WHERE`, in a fixed order, none of them read yet.

    Raises SourceError for an unknown kind, a folder that is missing or holds no clip, and a captions file, index or
    list of splits that does not fit its folder.
    """
    kind, _, where = spec.partition(":")
    if kind in _COUNTED:
        return _COUNTED[kind](_count(spec))
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


def _count(spec: str) -> int:
    where = spec.partition(":")[2]
    if not where.isdecimal() or not 0 < int(where) <= _MOST:
        raise SourceError(f"{spec}: the count must be from 1 to {_MOST}")
    return int(where)


def _bandai_namco(folder: Path) -> list[Clip]:
    clips = []
    for path in sorted(folder.rglob("dataset-[12]_*_*_*.bvh"), key=lambda p: p.name):
        said = re.fullmatch(r"dataset-\d_(.+)_(.+)_\d+", path.stem)
        if said is None or said[1] not in CONTENTS:
            raise SourceError(f"{path.name}: unknown content; known are {', '.join(CONTENTS)}")
        load = partial(_load_bandai_namco, path, said[1], style_name(said[2]))
        file = str(path.relative_to(folder))
        clips.append(Clip(f"bandai-namco/{path.stem}", "bandai-namco", file, load, stamp(path)))
    return clips


def _load_bandai_namco(path: Path, content: str, style: str) -> Sample:
    motion, name = read_motion(path), f"bandai-namco/{path.stem}"
    measured = measure(motion)
    captions = drawn(phrasings(content, style), name, measured)
    # Not the captions with their sides swapped: a plain "wave" means the right hand, also of the mirror image.
    there = drawn(phrasings(swap_sides(content), style), name, mirrored(measured))
    return Sample(motion, captions, there, motion.source.licence, content, style)


def _cmu(folder: Path) -> list[Clip]:
    index = folder / "index.csv"
    if not index.is_file():
        raise SourceError(f"cmu:{folder}: no index.csv with {', '.join(_INDEX_COLUMNS)} in this folder")
    said = {}
    for line, row in csv_rows(index, _INDEX_COLUMNS):
        subject, trial, words = row
        if not (subject.isdecimal() and trial.isdecimal()):
            raise SourceError(f"{index}: line {line}: subject {subject!r} and trial {trial!r} must be numbers")
        said[int(subject), int(trial)] = words.strip()
    clips = []
    for path in sorted(folder.rglob("*.bvh"), key=lambda p: p.name):
        number = re.fullmatch(r"(\d+)_(\d+)", path.stem)
        words = said.get((int(number[1]), int(number[2])), "") if number else ""
        if words:
            load = partial(_load_cmu, path, words)
            file = str(path.relative_to(folder))
            clips.append(Clip(f"cmu/{path.stem}", "cmu", file, load, stamp(path, [words])))
    return clips


def _load_cmu(path: Path, words: str) -> Sample:
    motion = read_motion(path)
    # Frame 0 of these files is a T-pose that is no part of the performance.
    return told(cut(motion, 1, len(motion)), (words,), f"cmu/{path.stem}", motion.source.licence)


def _folder(folder: Path) -> list[Clip]:
    found = [folder / name for name in ("captions.csv", "captions.jsonl") if (folder / name).is_file()]
    if len(found) != 1:
        have = "both captions.csv and captions.jsonl" if found else "neither captions.csv nor captions.jsonl"
        raise SourceError(f"folder:{folder}: {have} in this folder; one of them must say which file shows what")
    rows = csv_rows(found[0], ("file", "caption")) if found[0].suffix == ".csv" else jsonl_rows(found[0])
    captions: dict[str, list[str]] = {}
    for line, (name, caption) in rows:
        if not name.strip() or not caption.strip():
            raise SourceError(f"{found[0]}: line {line}: file {name!r} with caption {caption!r}; neither may be empty")
        if Path(name).suffix not in MOTION_FILES:
            raise SourceError(f"{found[0]}: line {line}: cannot read {name!r}; known are {', '.join(MOTION_FILES)}")
        if not (folder / name).is_file():
            raise SourceError(f"{found[0]}: line {line}: no file {name!r} in {folder}")
        captions.setdefault(name, []).append(caption.strip())
    return [_file(folder, file, tuple(said)) for file, said in sorted(captions.items())]


def _file(folder: Path, file: str, said: tuple[str, ...]) -> Clip:
    name = f"{folder.resolve().name}/{file}"
    return Clip(name, "folder", file, partial(_load_file, folder / file, said, name), stamp(folder / file, said))


def _load_file(path: Path, captions: tuple[str, ...], name: str) -> Sample:
    motion = read_motion(path)
    return told(motion, captions, name, motion.source.licence or "not stated")


def _gestures(count: int) -> list[Clip]:
    return [Clip(f"gestures/{i:06d}", "gestures", "", partial(_load_gesture, i)) for i in range(count)]


def _load_gesture(number: int) -> Sample:
    from motiongen.gestures.catalogue import LICENCE, sample

    motion, said = sample(np.random.default_rng(number))  # a clip is the same in every data set, whatever their size
    captions = drawn(said, f"gestures/{number:06d}")  # these know their own numbers
    family = motion.source.generator.removeprefix("gesture ")
    return Sample(motion, captions, tuple(map(swap_sides, captions)), LICENCE, family)


# What a folder of each kind is read by, and what must lie in it.
_OFFICIAL = "its new_joint_vecs holds no NUMBER.npy that its lists name"
_FOLDERS: dict[str, tuple[Callable[[Path], list[Clip]], str]] = {
    "bandai-namco": (_bandai_namco, "it needs files dataset-1_CONTENT_STYLE_NUMBER.bvh"),
    "cmu": (_cmu, "it needs files SUBJECT_TRIAL.bvh that index.csv describes"),
    "humanml3d": (partial(official_clips, HUMANML3D), _OFFICIAL),
    "kit-ml": (partial(official_clips, KIT_ML), _OFFICIAL),
    "folder": (_folder, "its captions file names none"),
}
_COUNTED = {"gestures": _gestures}  # kinds that need no files, only how many
_FORMS = ", ".join(
    (*(f"{kind}:FOLDER" for kind in _FOLDERS), *(f"{kind}:COUNT" for kind in _COUNTED), "composed:COUNT")
)
