"""Text to `Motion`: the interface of a generator, and the one in the tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from motiongen.motion import Motion

if TYPE_CHECKING:
    from motiongen.diffusion.timeline import Entry

MAX_TEXT = 1_000  # characters
MIN_SECONDS, MAX_SECONDS = 1.0, 60.0
WEIGHTS_SUFFIX = ".safetensors"


class PromptError(ValueError):
    """A prompt or a length that no generator takes; the message names the value and the good ones."""


@dataclass(frozen=True)
class Familiarity:
    """How close a text is to what a generator was trained on.

    `score`: cosine of the nearest training caption; `known`: whether that is enough; `nearest`: the nearest things
    the generator can do, best first.
    """

    known: bool
    score: float
    nearest: tuple[str, ...]


class Generator(Protocol):
    """Anything that turns text into motion; every one of them passes the same gate."""

    name: str
    licence: str

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """Motion for `text`, the same for the same arguments. `seconds` None: as long as such motions are."""
        ...

    def familiarity(self, text: str) -> Familiarity:
        """How close `text` is to the training captions."""
        ...


@runtime_checkable
class Control(Protocol):
    """A generator that can do more than follow one text; see `motiongen.diffusion.generator` for what each means."""

    def generate_action(
        self, action: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion: ...

    def generate_unconditioned(self, *, seconds: float | None = None, seed: int = 0) -> Motion: ...

    def generate_timeline(
        self, entries: Sequence[Entry], *, seed: int = 0, guidance: float | None = None
    ) -> Motion: ...

    def edit(
        self,
        clip: Motion,
        text: str | None = None,
        *,
        keep: str = "",
        parts: Sequence[str] = (),
        seed: int = 0,
        guidance: float | None = None,
    ) -> Motion: ...


def require_control(generator: Generator, name: str) -> Control:
    """`generator`, of that name, as one that can be controlled; raises PromptError where it cannot."""
    if not isinstance(generator, Control):
        raise PromptError(f"{name} follows one text only; mdm has timelines, actions and edits too")
    return generator


def check_prompt(text: str, seconds: float | None = None) -> str:
    """`text` without outer space; raises PromptError where it is empty or too long, or `seconds` out of range."""
    text = " ".join(text.split())
    if not text:
        raise PromptError("the text is empty; say what the rig should do, as in 'wave with the right hand'")
    if len(text) > MAX_TEXT:
        raise PromptError(f"the text has {len(text)} characters; at most {MAX_TEXT} are taken")
    if seconds is not None:
        check_seconds(seconds)
    return text


def check_seconds(seconds: float) -> None:
    """Raise PromptError for a length out of range."""
    if not MIN_SECONDS <= seconds <= MAX_SECONDS:
        raise PromptError(f"{seconds} seconds; between {MIN_SECONDS:g} and {MAX_SECONDS:g} are possible")


def list_generators() -> dict[str, str]:
    """Generators by name, and a line on each."""
    return {
        "mdm": "text to motion by diffusion (MDM, decoder form), trained on motion capture and gestures",
        "free": "the same network, trained only on motion that may be used commercially",
        "motiondiffuse": "text to motion by another network (MotionDiffuse), of efficient attention",
        "diffusionphase": "text to periodic phases by diffusion (DiffusionPhase): any length without falling off",
        "live": "MDM that goes on from what was done last: motion without end that answers at once (say --live)",
        "gestures": "hand-written gestures found by their names: nod, clap three times, bow 30 degrees; no weights",
    }


def load_generator(name: str = "mdm") -> Generator:
    """The generator `name`, or the one whose weights are in the file `name` that ends in .safetensors.

    Raises PromptError for a name not known, ModuleNotFoundError where the extra `generate` is missing, WeightsError
    where the weights are missing or broken.
    """
    if name == "gestures":
        from motiongen.gestures.generator import GestureGenerator

        return GestureGenerator()
    path = Path(name)
    if path.suffix != WEIGHTS_SUFFIX and name not in list_generators():
        raise PromptError(
            f"no generator {name!r}; there are {', '.join(list_generators())}, or a {WEIGHTS_SUFFIX} file"
        )
    from motiongen.diffusion.weights import FOLDER, goes_on, network_of

    file = path if path.suffix == WEIGHTS_SUFFIX else FOLDER / f"{name}{WEIGHTS_SUFFIX}"
    if network_of(file) == "diffusionphase":
        from motiongen.phase.generator import PhaseGenerator

        return PhaseGenerator(file)
    if goes_on(file):
        from motiongen.live.clips import LiveClips

        return LiveClips(file)
    from motiongen.diffusion.generator import DiffusionGenerator

    return DiffusionGenerator(file)


def is_live(name: str) -> bool:
    """Whether the generator `name`, or in the file `name`, goes on from what was done last; raises WeightsError for a
    file that is none."""
    if Path(name).suffix != WEIGHTS_SUFFIX:
        return name == "live"
    from motiongen.diffusion.weights import goes_on

    return goes_on(Path(name))
