"""`--out FILE`: what each suffix writes. Checked before any work is done, written under a temporary name."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from motiongen.motion import Motion
from retarget.robot_csv import Style
from rigcast.pipeline import Take
from rigcast.show import origin_line

if TYPE_CHECKING:
    from sim.preview import Preview


class OutputError(ValueError):
    """An `--out` that cannot be written; the message names it and what would do."""


def require_writable(paths: Iterable[Path], *, has_motion: bool, known: Collection[str] | None = None) -> None:
    """Raise OutputError for an unknown suffix, a folder that is not there or not writable, or a path given twice.

    `has_motion`: whether human motion will be there to write, or only a trajectory. `known`: the suffixes that may be
    written; by default all.
    """
    seen: set[Path] = set()
    for path in paths:
        suffix = suffix_of(path, known)
        if suffix in FROM_MOTION and not has_motion:
            raise OutputError(f"{path}: {suffix} holds human motion, but the input is a rig's trajectory")
        if path.is_dir() or not path.parent.is_dir():
            raise OutputError(f"{path}: {'is a folder' if path.is_dir() else f'no folder {path.parent}'}")
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            raise OutputError(f"{path}: not writable")
        if path.resolve() in seen:
            raise OutputError(f"{path}: given twice")
        seen.add(path.resolve())


def suffix_of(path: Path, known: Collection[str] | None = None) -> str:
    """The suffix, of those that are `known`, that decides what is written; raises OutputError that lists them."""
    known = WRITERS if known is None else known
    for suffix in known:  # the longer before the shorter
        if path.name.endswith(suffix) and path.name != suffix:
            return suffix
    raise OutputError(f"{path}: unknown suffix; known are {', '.join(known)}")


def write(take: Take, path: Path) -> None:
    """Write `take` to `path` in the form that its suffix names. Raises OutputError, OSError."""
    WRITERS[suffix_of(path)](take, path)


def _motion_npz(take: Take, path: Path) -> None:
    from motiongen.files import save_motion

    save_motion(_motion(take), path)


def _bvh(take: Take, path: Path) -> None:
    from motiongen.formats.bvh_write import write_bvh

    write_bvh(_motion(take), path)


def _motion(take: Take) -> Motion:
    if take.motion is None:
        raise OutputError("there is no human motion to write, only a rig's trajectory")
    return take.motion


def _trajectory_npz(take: Take, path: Path) -> None:
    from retarget.files import save_trajectory

    save_trajectory(take.trajectory, path)


def _amass(take: Take, path: Path) -> None:
    from motiongen.formats.amass import write_amass

    write_amass(_motion(take), path)


def _humanml(take: Take, path: Path) -> None:
    from motiongen.formats.humanml_npy import write_humanml

    write_humanml(_motion(take), path)


def _kit(take: Take, path: Path) -> None:
    from motiongen.formats.humanml_npy import write_kit

    write_kit(_motion(take), path)


def _glb(take: Take, path: Path) -> None:
    from motiongen.formats.gltf import write_glb

    write_glb(_motion(take), path)


def _csv(style: Style) -> Callable[[Take, Path], None]:
    def write_styled(take: Take, path: Path) -> None:
        from retarget.robot_csv import write_robot_csv

        write_robot_csv(take.trajectory, path, style)

    return write_styled


def _report_json(take: Take, path: Path) -> None:
    from motiongen.files import replacing

    with replacing(path) as temporary:
        temporary.write_text(json.dumps(take.report.to_dict(), indent=2) + "\n", encoding="utf-8")


def _report_page(take: Take, path: Path) -> None:
    from sim.report_page import write_page

    write_page(preview_of(take), path)


def preview_of(take: Take) -> Preview:
    """What previews show of `take`, with its servos as they were measured where they were."""
    from drivers.measured import as_measured
    from sim.preview import prepare

    return prepare(take.trajectory, as_measured(take.rig), take.report, take.rollout, origin_line(take))


def _video(take: Take, path: Path) -> None:
    from sim.render import render_video

    rollout = take.rollout
    render_video(rollout.qpos, rollout.fps, take.rig, path, mount=rollout.mount, title=_title(take))


def _sheet(take: Take, path: Path) -> None:
    from sim.render import render_sheet

    rollout = take.rollout
    render_sheet(rollout.qpos, rollout.fps, take.rig, path, mount=rollout.mount, title=_title(take))


def _title(take: Take) -> str:
    return "; ".join(label.text for label in take.trajectory.labels)


WRITERS: dict[str, Callable[[Take, Path], None]] = {
    ".motion.npz": _motion_npz,
    ".amass.npz": _amass,
    ".npz": _trajectory_npz,
    ".bvh": _bvh,
    ".glb": _glb,
    ".kit.npy": _kit,
    ".npy": _humanml,
    ".unitree.csv": _csv("unitree"),
    ".kimodo.csv": _csv("kimodo"),
    ".gmr.csv": _csv("gmr"),
    ".csv": _csv("ours"),
    ".json": _report_json,
    ".html": _report_page,
    ".mp4": _video,
    ".gif": _video,
    ".png": _sheet,
}
TELLING = (".html", ".json", ".mp4", ".gif", ".png")  # of a take that failed as well as of one that passed
FROM_MOTION = (".motion.npz", ".amass.npz", ".bvh", ".glb", ".kit.npy", ".npy")
