"""Motion files of our own: one `.npz` of plain arrays, no pickle; and the writing habit that every stage shares."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from motiongen.motion import Label, Motion, Skeleton, Source

VERSION = 1
MAX_BYTES = 1 << 30  # unpacked; an archive that promises more is refused before anything is unpacked
RATES = (0.1, 10_000.0)  # frames a second that a file may have
MAX_SECONDS = 4 * 3600.0  # a clip that lasts longer would not fit into memory at a robot's rate
_ROWS = 10_000
LARGEST = 1e9  # no coordinate or angle of any unit is above this; numbers near a float's end overflow later on


class FileError(ValueError):
    """A file that is not what it should be; the message names the file and what is wrong."""


def require_plausible(values: NDArray[Any]) -> None:
    """Raise ValueError where (T, ...) are no real numbers, or naming the first row with NaN, infinity or over 1e9."""
    if values.dtype.kind not in "fiu" or not values.ndim:
        raise ValueError(f"{values.dtype} {values.shape} where rows of numbers are expected")
    for start in range(0, len(values), _ROWS):  # in blocks: a mapped file may be large
        rows = np.abs(values[start : start + _ROWS].astype(float))
        fine = (rows <= LARGEST).reshape(len(rows), -1).all(1)
        if not fine.all():
            bad = start + int(fine.argmin())
            raise ValueError(f"frame {bad} holds NaN, infinity or a number above {LARGEST:g}")


def require_timing(frames: int, fps: float) -> None:
    """Raise ValueError where the frames a second are no camera's, or that many frames last over four hours."""
    if not RATES[0] <= fps <= RATES[1]:
        raise ValueError(f"{fps:.6g} frames a second, expected {RATES[0]:g} to {RATES[1]:g}")
    if frames / fps > MAX_SECONDS:
        raise ValueError(f"{frames} frames at {fps:.6g} a second last over {MAX_SECONDS / 3600:g} hours")


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary path in the same folder, with the same suffix; it becomes `path` when the block ends well.

    Where the block raises, `path` stays as it was and nothing is left behind. Raises OSError where the folder is not
    there or not writable.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(path.parent))
    temporary = path.with_name(f".{path.stem}-{os.getpid()}{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_npz(path: str | Path, kind: str, arrays: Mapping[str, Any]) -> None:
    """Write `arrays` with `kind` and the format's version to an `.npz`. The same content gives the same bytes.

    Raises OSError where `path` cannot be written.
    """
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, kind=kind, version=VERSION, **arrays)


def npz_names(path: str | Path) -> tuple[str, ...]:
    """Names of the arrays in an `.npz`, none of which is read. Raises FileError and OSError as `load_arrays` does."""
    with _opened(path) as archive:
        return tuple(archive.files)


def load_arrays(path: str | Path, wanted: Collection[str] | None = None) -> dict[str, Any]:
    """Arrays of an `.npz` by name, only the `wanted` ones where given; nothing in it is unpickled.

    Raises FileError where it is no `.npz`, damaged, over 1 GiB unpacked or holds objects; OSError where it cannot be
    opened.
    """
    with _opened(path) as archive:
        return {name: np.asarray(archive[name]) for name in archive.files if wanted is None or name in wanted}


@contextmanager
def _opened(path: str | Path) -> Iterator[NpzFile]:
    """The archive, its size checked; whatever goes wrong in reading it becomes one line."""
    with Path(path).open("rb") as file:
        try:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, NpzFile):
                raise FileError(f"{path}: a bare .npy array, expected an .npz file")
            size = sum(entry.file_size for entry in archive.zip.infolist()) if archive.zip else 0
            if size > MAX_BYTES:
                raise FileError(f"{path}: {size} bytes unpacked, expected at most {MAX_BYTES}")
            yield archive
        except FileError:
            raise
        except Exception:  # numpy and zipfile raise anything, SyntaxError included, on a damaged header
            raise FileError(f"{path}: not an .npz file, damaged, or holding objects") from None


def read_kind(path: str | Path, kind: str) -> dict[str, Any]:
    """Arrays by name of an `.npz` of ours that must be of `kind`.

    Raises FileError where it is no `.npz`, damaged, foreign, of another kind or version; OSError where it cannot be
    opened.
    """
    arrays = load_arrays(path)
    found, version = arrays.pop("kind", None), arrays.pop("version", None)
    if found is None or version is None or found.shape or version.shape or version.dtype.kind not in "iu":
        raise FileError(f"{path}: not written by rigcast (no kind and version in it: {', '.join(arrays) or 'empty'})")
    if int(version) != VERSION:
        raise FileError(f"{path}: format version {int(version)}, this rigcast reads version {VERSION}")
    if str(found) != kind:
        raise FileError(f"{path}: holds a {found}, expected a {kind}")
    return arrays


def notes_to_json(labels: tuple[Label, ...], source: Source) -> str:
    """Labels and source as one line of JSON, the form in which both kinds of file carry them."""
    return json.dumps({"labels": [asdict(label) for label in labels], "source": asdict(source)}, sort_keys=True)


def notes_from_json(text: str) -> tuple[tuple[Label, ...], Source]:
    """Undo `notes_to_json`. Raises ValueError, KeyError or TypeError where `text` is something else."""
    try:
        notes = json.loads(text)
    except RecursionError:
        raise ValueError("its notes are nested too deeply") from None
    labels = tuple(Label(n["start_s"], n["end_s"], n["text"], tuple(n["parts"])) for n in notes["labels"])
    return labels, Source(**notes["source"])


def save_motion(motion: Motion, path: str | Path) -> None:
    """Write `motion` without loss. Raises OSError where `path` cannot be written."""
    skeleton = motion.skeleton
    arrays = {
        "root_pos": motion.root_pos,
        "joint_quat": motion.joint_quat,
        "fps": float(motion.fps),
        "names": np.array(skeleton.names),
        "parents": np.array(skeleton.parents),
        "offsets": skeleton.offsets,
        "foot_height": np.array(skeleton.foot_height),
        "notes": notes_to_json(motion.labels, motion.source),
    }
    if motion.contacts is not None:
        arrays["contacts"] = motion.contacts
    write_npz(path, "motion", arrays)


def load_motion(path: str | Path) -> Motion:
    """Read what `save_motion` wrote.

    Raises FileError where the file is damaged, foreign, of another kind or version, or holds NaN, no frames or a frame
    rate that is not above 0; OSError where it cannot be opened.
    """
    arrays = read_kind(path, "motion")
    try:
        labels, source = notes_from_json(str(arrays["notes"]))
        ankle, toe = (float(h) for h in arrays["foot_height"])
        names, parents = tuple(map(str, arrays["names"])), tuple(map(int, arrays["parents"]))
        for name in ("root_pos", "joint_quat", "offsets"):
            require_plausible(arrays[name])
        skeleton = Skeleton(names, parents, arrays["offsets"], (ankle, toe))
        contacts = arrays["contacts"].astype(bool) if "contacts" in arrays else None
        fps = float(arrays["fps"])
        require_timing(len(arrays["root_pos"]), fps)
        return Motion(arrays["root_pos"], arrays["joint_quat"], fps, skeleton, labels, source, contacts)
    except KeyError as error:
        raise FileError(f"{path}: damaged motion file ({error} is missing)") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise FileError(f"{path}: {error}") from None
