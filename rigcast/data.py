"""`rigcast data build` and `rigcast data show`: make a data set, and look at it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from retarget.rig import Mount, load_rig
from rigcast.show import console, new_table, warn

if TYPE_CHECKING:
    from motiongen.data.dataset import Dataset

LISTED = 20  # clips without --clip
MOST_ROWS = 60  # of a sheet; a picture of more cannot be looked at
RIG = "humanoid"
MOUNT: Mount = "free"  # the clip as it is, walking where it walks


def build(sources: Positional[tuple[str, ...]], /, *, out: Path, jobs: int | None = None) -> int:
    """Make a data set in a folder; where it was interrupted, the same command goes on.

    Args:
        sources: bandai-namco:FOLDER, cmu:FOLDER (with index.csv), humanml3d:FOLDER, kit-ml:FOLDER, folder:FOLDER (with
            captions.csv or captions.jsonl), gestures:COUNT, composed:COUNT, any number of them; see docs/data.md.
        out: Folder of the data set.
        jobs: Processes that read clips; as many as there are cores where it is not said.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from motiongen.data.build import build as build_dataset

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task("reading clips", total=None)
        dataset, fresh = build_dataset(
            sources,
            out,
            jobs=(os.cpu_count() or 1) if jobs is None else jobs,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    if dataset.skipped:
        warn(f"{len(dataset.skipped)} clips were skipped, the first because {dataset.skipped[0].why}; see report.md")
    print(f"{out}: {'' if fresh else 'already built: '}{_summary(dataset)}; see {out / 'report.md'}")
    return 0


def show(
    folder: Positional[Path],
    /,
    *,
    clip: int | None = None,
    mirrored: bool = False,
    sheet: int | None = None,
    out: Path | None = None,
) -> int:
    """List the clips of a data set, or tell and draw one, or draw several.

    Args:
        folder: Folder of the data set.
        clip: Number of the clip; without it the first clips are listed.
        mirrored: Mirror images instead.
        sheet: Draw so many clips, as different as there are, a row each, into --out.
        out: A .png to draw into, on the humanoid rig (clip 0 where none is named).
    """
    from motiongen.data.dataset import open_dataset

    dataset = open_dataset(folder)
    if out is not None and (out.suffix != ".png" or not out.parent.is_dir()):
        raise ValueError(f"{out}: {'the suffix must be .png' if out.parent.is_dir() else f'no folder {out.parent}'}")
    if sheet is not None:
        return _draw_sheet(dataset, sheet, clip, mirrored, out)
    if clip is None and out is None:
        return _list(dataset)
    number = clip or 0
    if not 0 <= number < len(dataset):
        raise ValueError(f"no clip {number} in {folder}; there are 0 to {len(dataset) - 1}")
    if out is not None:
        _draw(dataset, number, mirrored, out)
    entry = dataset.entries[number]
    print(f"{number}: {entry.name}, {entry.seconds:.1f} s, {entry.split}; licence: {entry.licence}")
    print("\n".join(f"  {caption}" for caption in dataset.captions(number, mirrored)))
    return 0


def _list(dataset: Dataset) -> int:
    from rich.markup import escape

    table = new_table("clip", "name", "seconds", "split", "caption", title=escape(_summary(dataset)))
    for number, entry in enumerate(dataset.entries[:LISTED]):
        table.add_row(str(number), escape(entry.name), f"{entry.seconds:.1f}", entry.split, escape(entry.captions[0]))
    console().print(table)
    if len(dataset) > LISTED:
        print(f"… and {len(dataset) - LISTED} more; --clip N tells one of them")
    return 0


def _draw(dataset: Dataset, number: int, mirrored: bool, out: Path) -> None:
    from retarget.retarget import retarget
    from sim.render import render_sheet

    rig = load_rig(RIG)
    trajectory = retarget(dataset.motion(number, mirrored), rig, mount=MOUNT)
    render_sheet(trajectory.qpos, trajectory.fps, rig, out, mount=MOUNT, title=dataset.captions(number, mirrored)[0])


def _draw_sheet(dataset: Dataset, count: int, clip: int | None, mirrored: bool, out: Path | None) -> int:
    if out is None or clip is not None:
        raise ValueError(f"--sheet {count} needs --out FILE.png and no --clip: it draws several clips into one picture")
    if not 0 < count <= MOST_ROWS:
        raise ValueError(f"--sheet {count}: 1 to {MOST_ROWS} clips fit on a sheet")

    from motiongen.data.pictures import different
    from retarget.retarget import retarget
    from sim.gallery import render_gallery

    rig, numbers = load_rig(RIG), different(dataset.entries, count)
    rows = [
        (dataset.captions(number, mirrored)[0], retarget(dataset.motion(number, mirrored), rig, mount=MOUNT))
        for number in numbers
    ]
    render_gallery(rows, rig, out, mount=MOUNT)
    for number, (caption, _) in zip(numbers, rows, strict=True):
        print(f"{number}: {caption}")
    return 0


def _summary(dataset: Dataset) -> str:
    hours = sum(entry.seconds for entry in dataset.entries) / 3600
    captions = len({caption for entry in dataset.entries for caption in entry.captions})
    return f"{len(dataset)} clips, {hours:.2f} h, {captions} captions"
