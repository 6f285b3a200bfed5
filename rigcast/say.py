"""`rigcast say`: the whole line, from a sentence, a timeline, an action or nothing to files, a stream and a preview."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from motiongen.candidates import DEFAULT_CANDIDATES
from motiongen.generator import Generator, PromptError, check_prompt, check_seconds, load_generator, require_control
from motiongen.motion import Motion
from retarget.rig import Mount, Rig, load_rig
from rigcast import show
from rigcast.delivery import Delivery, deliver, require
from rigcast.saying import Saying, UnfamiliarError
from rigcast.times import Times

WAYS = "a TEXT, --timeline FILE, --action NAME or --unconditioned"


def say(
    text: Annotated[Positional[str | None], arg(metavar="TEXT")] = None,
    /,
    *,
    timeline: Annotated[Path | None, arg(metavar="FILE")] = None,
    action: Annotated[str | None, arg(metavar="NAME")] = None,
    unconditioned: bool = False,
    rig: str = "puppet",
    model: Path | None = None,
    mount: Mount | None = None,
    seconds: float | None = None,
    seed: int = 0,
    generator: str = "mdm",
    guidance: float | None = None,
    candidates: int = DEFAULT_CANDIDATES,
    strict: bool = False,
    live: bool = False,
    floor: Annotated[float | None, arg(metavar="METRES")] = None,
    delivery: Annotated[Delivery, arg(name="")] = Delivery(),  # noqa: B008
) -> int:
    """Generate a motion for TEXT, retarget it, check it in physics, then write, stream or show it.

    Args:
        text: What the rig should do, in English, such as "wave with the right hand".
        timeline: Instead of a text, a file of what happens when: a line is `text # start # end # parts`.
        action: Instead of a text, an action of the training data, such as wave.
        unconditioned: Instead of a text, nothing: any motion at all.
        rig: Name of a rig (see `rigcast rigs`) or path of its folder.
        model: The rig's MJCF, where it is not where the rig looks for it.
        mount: How the base is held; by default as the rig says.
        seconds: Length; by default what the generator finds natural.
        seed: The same seed gives the same motion.
        generator: Name of a generator (see `rigcast generators`).
        guidance: How strictly the text is followed; by default as the generator is best at.
        candidates: Motions drawn at most for a text, of which the one is kept that does what can be measured of it.
        strict: Exit 1 where a text is far from everything that the generator was trained on.
        live: Stream without end, and do what is typed, line by line, at once; see docs/live.md.
        floor: With --live, how far from where it begins it may walk in each direction.
    """
    if live:
        _require_plain(timeline, action, unconditioned, seconds)
        return _live(text, load_rig(rig, model), mount, seed, generator, floor, delivery)
    if floor is not None:
        raise PromptError("--floor goes with --live")
    times = Times()
    texts = _texts(text, timeline, action, unconditioned, seconds)
    require(delivery, has_motion=True)
    body = load_rig(rig, model)
    with times.stage("load generator"):
        drawing = load_generator(generator)
    saying = Saying(drawing, generator, body, mount, seconds, guidance, candidates, strict, delivery.fix)
    try:
        if text is not None:
            taken, said = saying.say(text, seed, times, show.warn)
        else:
            said = {"text": None, **saying.familiar(texts, show.warn)}
            with times.stage("generate"):
                motion = _controlled(drawing, generator, timeline, action, seconds, seed, guidance)
            taken = saying.judged(motion, times, show.warn)
    except UnfamiliarError as far:
        show.warn(str(far))
        return 1
    return deliver(taken, delivery, times, said, saying)


def _live(
    text: str | None, rig: Rig, mount: Mount | None, seed: int, generator: str, floor: float | None, delivery: Delivery
) -> int:
    from drivers.endpoint import DEFAULT
    from rigcast.live import NAME, Stage
    from rigcast.prompt import prompt

    name = NAME if generator == "mdm" else generator
    stage = Stage(rig, mount, name, seed, floor, delivery.publish or DEFAULT, delivery.insecure)
    return prompt(stage, delivery, text)


def _require_plain(timeline: Path | None, action: str | None, unconditioned: bool, seconds: float | None) -> None:
    if timeline is not None or action is not None or unconditioned or seconds is not None:
        raise PromptError("--live follows what is typed; leave --timeline, --action, --unconditioned and --seconds out")


def _texts(
    text: str | None, timeline: Path | None, action: str | None, unconditioned: bool, seconds: float | None
) -> list[str]:
    """What is said in words. Raises PromptError unless there is one thing to say, and what reading it raises."""
    given = [text is not None, timeline is not None, action is not None, unconditioned]
    if sum(given) != 1:
        raise PromptError(f"say one thing: {WAYS}")
    if seconds is not None:
        check_seconds(seconds)
    if timeline is None:
        return [] if text is None else [check_prompt(text)]
    if seconds is not None:
        raise PromptError(f"--seconds {seconds:g}: a timeline says itself how long it is")
    from motiongen.diffusion.timeline import read_timeline

    return list(dict.fromkeys(entry.text for entry in read_timeline(timeline)))


def _controlled(
    model: Generator,
    name: str,
    timeline: Path | None,
    action: str | None,
    seconds: float | None,
    seed: int,
    guidance: float | None,
) -> Motion:
    able = require_control(model, name)
    if timeline is not None:
        from motiongen.diffusion.timeline import read_timeline

        return able.generate_timeline(read_timeline(timeline), seed=seed, guidance=guidance)
    if action is not None:
        return able.generate_action(action, seconds=seconds, seed=seed, guidance=guidance)
    return able.generate_unconditioned(seconds=seconds, seed=seed)
