"""`rigcast check FILE`: the physics report, printed, written as a page, filmed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

from retarget.rig import Mount
from retarget.robot_csv import Style
from rigcast import show
from rigcast.play import rig_for
from rigcast.times import Times


def check(
    file: Positional[Path],
    /,
    *,
    rig: str | None = None,
    mount: Mount | None = None,
    style: Style = "ours",
    fps: float | None = None,
    fix: bool = False,
    trials: int = 0,
    seed: int = 0,
    out: Annotated[UseAppendAction[tuple[Path, ...]], arg(metavar="FILE")] = (),
    json: bool = False,
) -> int:
    """Put FILE through physics and report on it; exit 0 where it passes, 1 where it fails, 2 where unreadable.

    Args:
        file: .bvh, .npz (rigcast's or AMASS), .npy (HumanML3D) or .csv (a rig's joints); see docs/files.md.
        rig: Name of a rig or path of its folder; by default the rig of the trajectory, or puppet.
        mount: How the base is held; by default as the rig says.
        style: Whose .csv it is: ours has a header, the others only numbers.
        fps: Frames a second of a .csv without a time column, where its style does not fix them.
        fix: Mend what fails and judge that; --out of `play` writes it.
        trials: Also on so many rigs a little other than thought, each pushed once; nine in ten must pass.
        seed: Of what is other in the trials.
        out: Write the report, whatever it says: .html (one page with pictures and plots), .json, or .mp4 .gif .png of
            what physics made of the motion.
        json: Print one JSON document instead of a table.
    """
    from rigcast.outputs import TELLING, require_writable, write
    from rigcast.pipeline import read, take

    require_writable(out, has_motion=False, known=TELLING)
    what = read(file, rig, style, fps)
    taken = take(what, rig_for(what, rig), mount, Times(), fix=fix, trials=trials, seed=seed)
    for path in out:
        write(taken, path)
    if json:
        show.print_json(show.take_dict(taken))
    else:
        show.console().print(show.report_table(taken.report))
        for change in taken.report.changes:
            print(f"mended: {change.text}")
        for path in out:
            print(f"wrote {path}")
    return 0 if taken.report.ok else 1
