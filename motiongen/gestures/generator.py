"""Text to motion with neither weights nor training: the gesture that the text names."""

from __future__ import annotations

from dataclasses import replace

from motiongen.generator import Familiarity, PromptError, check_prompt
from motiongen.gestures.assemble import UNEVEN
from motiongen.gestures.catalogue import LICENCE, gesture, gestures, perform
from motiongen.gestures.gesture import MAX_COUNT, Gesture, Params
from motiongen.gestures.reading import Request, read
from motiongen.gestures.track import length
from motiongen.motion import Label, Motion


class GestureGenerator:
    """The gestures of `motiongen.gestures`, found by their names in the text."""

    name = "gestures"
    licence = LICENCE

    def familiarity(self, text: str) -> Familiarity:
        """Known is a text that names a gesture, and asks nothing of it that the gesture does not have.

        Raises PromptError for a text that nobody could follow.
        """
        request = read(check_prompt(text))
        known = request.name is not None and _has_all(gesture(request.name), request)
        return Familiarity(known, 1.0 if known else 0.0, request.nearest)

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """The gesture that `text` names, as it says: side, count, degrees, fast or slow. `guidance` changes nothing.

        `seconds`: repeats what can be repeated, or hurries within what is natural, or stands on, to fill them. Raises
        PromptError where the text names no gesture, or a count, angle or length that the gesture cannot take.
        """
        request = read(check_prompt(text, seconds))
        if request.name is None:
            raise PromptError(f"{text!r} names no gesture; there are {', '.join(gestures())}")
        family = gesture(request.name)
        try:
            wish = _params(family, request)
            if seconds is not None:
                wish = _fitted(family, wish, seconds, free=request.count is None)
            motion = perform(
                family.name, side=wish.side or None, count=wish.count, speed=wish.speed, amplitude=wish.amplitude,
                seed=seed, seconds=seconds,
            )  # fmt: skip
        except PromptError:
            raise
        except ValueError as error:
            raise PromptError(str(error)) from None
        return replace(motion, labels=(Label(0.0, motion.duration, text),))


def _has_all(family: Gesture, request: Request) -> bool:
    side = request.side is None or request.side in family.sides or (request.side == "both" and not family.sides)
    return (
        side
        and (request.count or 1) <= (MAX_COUNT if family.repeats else 1)
        and (request.degrees is None or bool(family.degrees))
    )


def _params(family: Gesture, request: Request) -> Params:
    """What is asked for, as far as the family has it; words like "fast" mean no more than the family allows."""
    amplitude = min(max(request.amplitude or 1.0, family.amplitudes[0]), family.amplitudes[1])
    if request.degrees is not None and family.degrees:
        amplitude = request.degrees / family.degrees
    return family.params(
        side=request.side if request.side in family.sides else None,
        count=request.count if family.repeats else None,
        speed=min(max(request.speed or 1.0, family.speeds[0]), family.speeds[1]),
        amplitude=amplitude,
    )


def _fitted(family: Gesture, params: Params, seconds: float, *, free: bool) -> Params:
    """`params` with the count, where it is `free`, and the speed with which the gesture fits into `seconds`."""

    def needs(wish: Params) -> float:
        return length(family.build(wish), wish.speed) * (1 + UNEVEN)

    while (
        free
        and family.repeats
        and params.count < MAX_COUNT
        and needs(more := replace(params, count=params.count + 1)) <= seconds
    ):
        params = more
    speed = params.speed * max(1.0, needs(params) / seconds)
    if speed > family.speeds[1]:
        fastest = needs(replace(params, speed=family.speeds[1]))
        raise PromptError(f"{seconds:g} seconds are too short for {family.name}; it takes {fastest:.1f} or more")
    return replace(params, speed=speed)
