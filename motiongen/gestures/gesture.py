"""What a family of gestures is: how it moves, what may be asked of it, and how people say it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from motiongen.gestures.phrases import Said, captions
from motiongen.gestures.pose import Step

MAX_COUNT = 20


@dataclass(frozen=True)
class Params:
    """One performance: `side` is "left", "right", "both" or, where the gesture has none, ""; `count` repetitions;
    `speed` and `amplitude` as factors of the usual; `angle` in radians, 0 where the gesture has none."""

    side: str = ""
    count: int = 1
    speed: float = 1.0
    amplitude: float = 1.0
    angle: float = 0.0


@dataclass(frozen=True)
class Gesture:
    """A family of gestures.

    `build` gives the steps of the right side (or of "both"); whoever plays them mirrors them for the left. `verbs` are
    verb phrases with the verb in brackets, `{side}` where the side goes and `{steps}` where a count of steps does;
    `both` those for both sides at once; `named` those that say an angle, by degrees, without a number. Its angles, with
    or without such a phrase, are what people mostly ask for.
    `keywords`: what names the gesture in a text, each a set of words. `sides`: those it has, the usual one first.
    `repeats`: whether it can be done more than once; `usual`: how often, where nobody says. `degrees`: its angle at
    amplitude 1, said after `preposition`. `amplitudes` and `speeds`: lowest and highest. `unit`: what is counted, where
    not "times".
    """

    name: str
    build: Callable[[Params], list[Step]]
    verbs: tuple[str, ...]
    keywords: tuple[str, ...]
    sides: tuple[str, ...] = ()
    both: tuple[str, ...] = ()
    repeats: bool = False
    usual: int = 1
    degrees: float = 0.0
    preposition: str = "by"
    amplitudes: tuple[float, float] = (0.5, 1.4)
    speeds: tuple[float, float] = (0.5, 1.6)
    unit: str = ""
    named: dict[int, tuple[str, ...]] = field(default_factory=dict)

    def params(
        self, *, side: str | None = None, count: int | None = None, speed: float = 1.0, amplitude: float = 1.0
    ) -> Params:
        """The values as one performance; a `side` and a `count` of None are the usual ones.

        Raises ValueError naming a value that this gesture cannot take, and those it can.
        """
        if side is None:
            side = self.sides[0] if self.sides else ""
        elif side not in self.sides:
            have = f"takes {' or '.join(self.sides)}" if self.sides else "has no sides"
            raise ValueError(f"{self.name}: side {side!r}; it {have}")
        if count is None:
            count = self.usual
        most = MAX_COUNT if self.repeats else 1
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= most:
            raise ValueError(
                f"{self.name}: count {count!r}; {f'1 to {most} are' if self.repeats else 'only 1 is'} possible"
            )
        for what, value, (low, high) in (("speed", speed, self.speeds), ("amplitude", amplitude, self.amplitudes)):
            if not low - 1e-9 <= value <= high + 1e-9:
                span = f"{low:g}" if low == high else f"{low:g} to {high:g}"
                raise ValueError(f"{self.name}: {what} {value:g}; {span} is possible{self._in_degrees(what)}")
        return Params(side, count, float(speed), float(amplitude), math.radians(self.degrees * amplitude))

    def captions(self, params: Params) -> tuple[str, ...]:
        """Natural phrasings of a performance, third person, imperative and casual; each says what is not as usual."""
        degrees = round(math.degrees(params.angle)) if self.degrees else 0
        said = Said(
            degrees=degrees,
            preposition=self.preposition,
            count=params.count if self.repeats else 0,
            usual=self.usual,
            unit=self.unit,
            speed=params.speed,
            amplitude=params.amplitude,
        )
        if params.side == "both":
            return captions(self.both, said)
        verbs, named = (
            tuple(verb.replace("{side}", params.side) for verb in each)
            for each in (self.verbs, self.named.get(degrees, ()))
        )
        return captions(verbs, said) + captions(named, replace(said, degrees=0, amplitude=1.0))

    def _in_degrees(self, what: str) -> str:
        if what != "amplitude" or not self.degrees:
            return ""
        low, high = (self.degrees * a for a in self.amplitudes)
        return f", which is {low:.0f} to {high:.0f} degrees"
