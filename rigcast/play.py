"""`rigcast play FILE`: the line from a motion or trajectory file on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from retarget.rig import Mount, Rig, load_rig
from retarget.robot_csv import Style
from retarget.shown import cannot_show
from retarget.trajectory import Trajectory
from rigcast import show
from rigcast.delivery import Delivery, deliver, require
from rigcast.pipeline import DEFAULT_RIG, read, take
from rigcast.times import Times


def play(
    file: Positional[Path],
    /,
    *,
    rig: str | None = None,
    model: Path | None = None,
    mount: Mount | None = None,
    style: Style = "ours",
    fps: float | None = None,
    delivery: Annotated[Delivery, arg(name="")] = Delivery(),  # noqa: B008
) -> int:
    """Retarget what is in FILE where it is human motion, check it in physics, then write, stream or show it.

    Args:
        file: .bvh, .npz (rigcast's or AMASS), .npy (HumanML3D), .csv (a rig's joints) or .rigrec (a recorded stream);
            see docs/files.md.
        rig: Name of a rig or path of its folder; by default the rig of the trajectory, or puppet.
        model: The rig's MJCF, where it is not where the rig looks for it.
        mount: How the base is held; by default as the rig says.
        style: Whose .csv it is: ours has a header, the others only numbers.
        fps: Frames a second of a .csv without a time column, where its style does not fix them.
    """
    times = Times()
    with times.stage("read"):
        what = read(file, rig, style, fps)
    require(delivery, has_motion=not isinstance(what, Trajectory))
    body = rig_for(what, rig, model)
    for note in cannot_show(what, body):
        show.warn(note)
    return deliver(take(what, body, mount, times, fix=delivery.fix), delivery, times, {"file": str(file)})


def rig_for(what: object, named: str | None, model: Path | None = None) -> Rig:
    """The rig that was named, else the one that a trajectory was made for, else the default. Raises RigError."""
    return load_rig(named or (what.rig if isinstance(what, Trajectory) else DEFAULT_RIG), model)
