"""Damaged motion files by the thousand: every one is read or refused in one line, in little time and memory.

The property itself; `tests/test_formats.py` holds it on a few examples, `motion_files.py --fuzz N` on N a format.
"""

from __future__ import annotations

import io
import resource
import signal
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, get_args

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motiongen.files import save_motion
from motiongen.formats.amass import write_amass
from motiongen.formats.bvh_write import write_bvh
from motiongen.formats.humanml_npy import humanml_positions, write_humanml, write_kit
from motiongen.motion import SMPL_JOINTS, Motion
from motiongen.smpl import SMPL_SKELETON
from retarget.files import save_trajectory
from retarget.rig import load_rig
from retarget.robot_csv import Style, write_robot_csv
from retarget.trajectory import Trajectory
from rigcast.pipeline import read

RIG = "puppet"
FORMATS = (".bvh", ".npz", ".npy", ".csv")
MEMORY = 1 << 30  # bytes that a run may take on top of what it began with
GUARD = 4 << 30  # bytes of address space on top of it, beyond which the system stops the run
SECONDS = 10  # that one file may take
ODD_WORDS = (
    "", "nan", "inf", "-1", "0", "1e308", "-1e9", "1e-320", "999999999999", "1_0", "0x10", "٣", "{", "}", "End",
    "JOINT", "OFFSET", "CHANNELS", "MOTION", "Frames:", "Xrotation", ",", "\x00",
)  # fmt: skip
ODD_ARRAYS: tuple[Any, ...] = (
    np.float64("nan"), np.float64("inf"), 1e308, 1e-308, -1.0, 0, 2**62, True, 1j, "text", b"bytes", np.zeros(0),
    np.zeros((0, 3)), np.zeros((4, 0)), np.full((3, 3), 1e300), np.ones((2, 22, 3), "f2"), np.ones((5, 263), ">f4"),
    np.asfortranarray(np.ones((5, 251))), np.arange(6), np.array([{}], object), np.zeros(3, "f8,i4"),
    np.array("2026-01-01", "M8[D]"), np.array(["left_hip"] * 22), np.ones((2, 2, 2, 2, 2)), np.array("{}"),
    np.array('{"labels": 3, "source": []}'), np.array("[" * 5000),
)  # fmt: skip


class TooSlow(BaseException):
    """Raised out of a reader that takes over SECONDS; no reader may catch it as a damaged file."""


def one_of_each(folder: Path) -> dict[str, bytes]:
    """Content by name of a small good file of every readable kind: a second of standing still."""
    still = np.tile([1.0, 0.0, 0.0, 0.0], (31, len(SMPL_JOINTS), 1))
    clip = Motion(np.tile([0.0, 0.0, 0.9], (31, 1)), still, 30.0, SMPL_SKELETON)
    joints = load_rig(RIG).joint_names()
    qpos = np.zeros((31, 7 + len(joints)))
    qpos[:, 2], qpos[:, 3] = 0.3, 1.0
    pose = Trajectory(qpos, 30.0, RIG, joints)
    save_motion(clip, folder / "ours.npz")
    save_trajectory(pose, folder / "trajectory.npz")
    write_amass(clip, folder / "amass.npz")
    write_bvh(clip, folder / "clip.bvh")
    write_humanml(clip, folder / "features.npy")
    write_kit(clip, folder / "kit.npy")
    np.save(folder / "joints.npy", humanml_positions(clip))
    for style in get_args(Style):
        write_robot_csv(pose, folder / f"{style}.csv", style)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def style_of(name: str) -> Style:
    """The style of a `.csv` of `one_of_each` by its name, and "ours" for every other file."""
    return next((style for style in get_args(Style) if name == f"{style}.csv"), "ours")


@st.composite
def damaged(draw: st.DrawFn, good: dict[str, bytes]) -> tuple[str, bytes]:
    """Name and content of a good file after one or two blows, on its bytes or on what it says."""
    name = draw(st.sampled_from(sorted(good)))
    content = good[name]
    for _ in range(draw(st.integers(1, 2))):
        content = draw(st.sampled_from([_bytes, _BLOWS[Path(name).suffix]]))(draw, content)
    return name, content


def outcome(folder: Path, name: str, content: bytes) -> str:
    """ "read" or "refused". Raises AssertionError where the refusal is not one line that names the file, and whatever
    else escapes the reader.
    """
    path = folder / name
    path.write_bytes(content)
    style = style_of(name)
    try:
        read(path, RIG, style, 50.0 if style == "gmr" else None)
    except ValueError as error:
        if "\n" in str(error) or name not in str(error):
            raise AssertionError(f"not one line that names the file: {error}") from error
        return "refused"
    return "read"


def fuzz(count: int) -> dict[str, Any]:
    """Try `count` damaged files of each format. Returns how many were read and refused, by format, and the peak of
    memory in MB on top of the start's. Raises where one is neither read nor refused, or takes over 10 s or 1 GiB.
    """
    before = _peak()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_size() + GUARD, hard))
    handler = signal.signal(signal.SIGALRM, _stop)
    try:
        with tempfile.TemporaryDirectory() as room:
            good = one_of_each(Path(room))
            counts = {suffix: _tried(Path(room), good, suffix, count) for suffix in FORMATS}
    finally:
        signal.signal(signal.SIGALRM, handler)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    if _peak() - before > MEMORY:
        raise MemoryError(f"{_peak() - before} bytes, expected at most {MEMORY}")
    return {"files": counts, "peak_mb": round((_peak() - before) / 1e6)}


def _tried(room: Path, good: dict[str, bytes], suffix: str, count: int) -> dict[str, int]:
    seen: Counter[str] = Counter()
    some = {name: content for name, content in good.items() if name.endswith(suffix)}
    checks = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example]

    @settings(max_examples=count, deadline=None, derandomize=True, database=None, suppress_health_check=checks)
    @given(damaged(some))
    def each(file: tuple[str, bytes]) -> None:
        signal.alarm(SECONDS)
        try:
            seen[outcome(room, *file)] += 1
        finally:
            signal.alarm(0)

    each()
    return dict(seen)


def _bytes(draw: st.DrawFn, content: bytes) -> bytes:
    """Bytes put in, changed or cut out somewhere."""
    at = draw(st.integers(0, max(len(content) - 1, 0)))
    return content[:at] + draw(st.binary(max_size=6)) + content[at + draw(st.sampled_from([0, 1, 7, 1000])) :]


def _words(draw: st.DrawFn, content: bytes) -> bytes:
    """One word of a text, or one cell of a table, taken for an odd one, or a whole line gone or said twice."""
    lines = content.decode("utf-8", "replace").split("\n")
    row = draw(st.integers(0, len(lines) - 1))
    kind = draw(st.sampled_from(["word", "gone", "twice"]))
    if kind == "word":
        separator = "," if "," in lines[row] else " "
        words = lines[row].split(separator)
        words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(ODD_WORDS))
        lines[row] = separator.join(words)
    else:
        lines[row : row + 1] = [] if kind == "gone" else [lines[row]] * 2
    return "\n".join(lines).encode()


def _archive(draw: st.DrawFn, content: bytes) -> bytes:
    """One array of an archive taken away, or replaced by an odd one, or its shape or a number in it changed."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except Exception:  # an earlier blow has broken it
        return content
    if arrays:
        name = draw(st.sampled_from(sorted(arrays)))
        changed = draw(st.sampled_from([None, _changed(draw, arrays[name])]))
        arrays = {n: a for n, a in {**arrays, name: changed}.items() if a is not None}
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def _array(draw: st.DrawFn, content: bytes) -> bytes:
    """The array of an `.npy` changed as one of an archive."""
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    except Exception:  # an earlier blow has broken it
        return content
    out = io.BytesIO()
    np.save(out, _changed(draw, array))
    return out.getvalue()


def _changed(draw: st.DrawFn, array: np.ndarray) -> np.ndarray:
    kind = draw(st.sampled_from(["odd", "shape", "number"]))
    if kind == "odd" or not array.size:
        return np.asarray(draw(st.sampled_from(ODD_ARRAYS)))
    if kind == "shape":
        flat = array.ravel()
        return draw(st.sampled_from([array.T, array[None], flat, flat[:1], np.concatenate([flat, flat])]))
    if array.dtype.kind != "f":
        return np.roll(array, 1)
    out = array.copy()
    with np.errstate(over="ignore"):  # half precision makes infinity of 1e10
        out.flat[draw(st.integers(0, array.size - 1))] = draw(st.sampled_from([np.nan, np.inf, 0.0, -1e30, 1e10, 0.5]))
    return out


_BLOWS: dict[str, Callable[[st.DrawFn, bytes], bytes]] = {
    ".bvh": _words,
    ".csv": _words,
    ".npz": _archive,
    ".npy": _array,
}


def _stop(number: int, frame: FrameType | None) -> None:
    raise TooSlow(f"a file took over {SECONDS} s")


def _peak() -> int:
    """Largest resident size of this process so far, bytes (Linux counts it in KiB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _size() -> int:
    """Address space of this process now, bytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * resource.getpagesize()
