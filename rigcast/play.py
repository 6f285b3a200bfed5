"""`rigcast play FILE`: the line from a motion or trajectory file on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from retarget.rig import Mount, Rig, load_rig
from retarget.trajectory import Trajectory
from rigcast.delivery import Delivery, deliver, require
from rigcast.times import Times

DEFAULT_RIG = "puppet"


def play(
    file: Positional[Path],
    /,
    *,
    rig: str | None = None,
    mount: Mount | None = None,
    delivery: Annotated[Delivery, arg(name="")] = Delivery(),  # noqa: B008
) -> int:
    """Retarget what is in FILE where it is human motion, check it in physics, then write, stream or show it.

    Args:
        file: A .bvh, or an .npz that rigcast wrote (motion or trajectory).
        rig: Name of a rig or path of its folder; by default the rig of the trajectory, or puppet.
        mount: How the base is held; by default as the rig says.
    """
    from rigcast.pipeline import read, take

    times = Times()
    with times.stage("read"):
        what = read(file)
    require(delivery, has_motion=not isinstance(what, Trajectory))
    return deliver(take(what, rig_for(what, rig), mount, times), delivery, times, {"file": str(file)})


def rig_for(what: object, named: str | None) -> Rig:
    """The rig that was named, else the one that a trajectory was made for, else the default. Raises RigError."""
    return load_rig(named or (what.rig if isinstance(what, Trajectory) else DEFAULT_RIG))
