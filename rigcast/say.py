"""`rigcast say TEXT`: the whole line, from a sentence to files, a stream and a preview."""

from __future__ import annotations

from typing import Annotated, Any

from tyro.conf import Positional, arg

from motiongen.candidates import DEFAULT_CANDIDATES, choose
from motiongen.generator import check_prompt, load_generator
from retarget.rig import Mount, load_rig
from rigcast import show
from rigcast.delivery import Delivery, deliver, require
from rigcast.times import Times


def say(
    text: Positional[str],
    /,
    *,
    rig: str = "puppet",
    mount: Mount | None = None,
    seconds: float | None = None,
    seed: int = 0,
    generator: str = "mdm",
    guidance: float | None = None,
    candidates: int = DEFAULT_CANDIDATES,
    strict: bool = False,
    delivery: Annotated[Delivery, arg(name="")] = Delivery(),  # noqa: B008
) -> int:
    """Generate a motion for TEXT, retarget it, check it in physics, then write, stream or show it.

    Args:
        text: What the rig should do, in English, such as "wave with the right hand".
        rig: Name of a rig (see `rigcast rigs`) or path of its folder.
        mount: How the base is held; by default as the rig says.
        seconds: Length; by default what the generator finds natural.
        seed: The same seed gives the same motion.
        generator: Name of a generator (see `rigcast generators`).
        guidance: How strictly the text is followed; by default as the generator is best at.
        candidates: Motions drawn at most, of which the one is kept that does what can be measured of the text.
        strict: Exit 1 where the text is far from everything that the generator was trained on.
    """
    times = Times()
    text = check_prompt(text, seconds)
    require(delivery, has_motion=True)
    body = load_rig(rig)
    with times.stage("load generator"):
        model = load_generator(generator)
    familiarity = model.familiarity(text)
    if not familiarity.known:
        show.warn(f"{text!r} is far from what {generator} was trained on; nearest: {', '.join(familiarity.nearest)}")
        if strict:
            return 1
    with times.stage("generate"):
        kept = choose(model, text, candidates=candidates, seconds=seconds, seed=seed, guidance=guidance)
    if kept.drawn > 1:
        show.warn(str(kept))
    from rigcast.pipeline import take

    said: dict[str, Any] = {"text": text, "known": familiarity.known, "nearest": list(familiarity.nearest)}
    said |= {"candidates": kept.drawn, "kept": kept.index + 1, "measured": kept.asked, "right": kept.right}
    return deliver(take(kept.motion, body, mount, times), delivery, times, said)
