"""`rigcast edit FILE`: some frames or some parts of somebody's clip drawn anew, then the line as from `say`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from motiongen.formats.reading import read_motion
from motiongen.generator import load_generator, require_control
from retarget.rig import Mount, load_rig
from rigcast.delivery import Delivery, deliver, require
from rigcast.pipeline import DEFAULT_RIG, take
from rigcast.times import Times


def edit(
    file: Positional[Path],
    /,
    *,
    keep: Annotated[str, arg(metavar="RANGES")] = "",
    parts: Annotated[str, arg(metavar="PARTS")] = "",
    text: str | None = None,
    rig: str = DEFAULT_RIG,
    mount: Mount | None = None,
    seed: int = 0,
    generator: str = "mdm",
    guidance: float | None = None,
    delivery: Annotated[Delivery, arg(name="")] = Delivery(),  # noqa: B008
) -> int:
    """Draw part of the motion in FILE anew, retarget it, check it in physics, then write, stream or show it.

    Args:
        file: .bvh, .npz (rigcast's or AMASS) or .npy (HumanML3D, KIT-ML) of human motion; see docs/files.md.
        keep: Frames that stay, in seconds as 0:1s,3s: or in frames as 0:30,90:; the others are drawn anew.
        parts: Parts of the body that are drawn anew, such as left_arm,head; the others stay.
        text: What is to happen there; by default whatever fits.
        rig: Name of a rig (see `rigcast rigs`) or path of its folder.
        mount: How the base is held; by default as the rig says.
        seed: The same seed gives the same motion.
        generator: Name of a generator (see `rigcast generators`).
        guidance: How strictly the text is followed; by default as the generator is best at.
    """
    times = Times()
    with times.stage("read"):
        clip = read_motion(file)
    require(delivery, has_motion=True)
    body = load_rig(rig)
    with times.stage("load generator"):
        able = require_control(load_generator(generator), generator)
    named = [part.strip() for part in parts.split(",")] if parts else []
    with times.stage("edit"):
        motion = able.edit(clip, text, keep=keep, parts=named, seed=seed, guidance=guidance)
    said = {"file": str(file), "keep": keep, "parts": named, "text": text}
    return deliver(take(motion, body, mount, times, fix=delivery.fix), delivery, times, said)
