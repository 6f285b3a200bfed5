"""One clip of a source, before and after it is read, and what every kind of source does with it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from motiongen.measure.clip import Measured, measure
from motiongen.motion import Motion
from motiongen.text.captions import kept_for_testing, swap_sides
from motiongen.text.say_numbers import says_time, with_numbers

MOST_CAPTIONS = 12  # a clip, where a grammar could say hundreds
MOST_NUMBERED = 4  # of them with a measured number, and never more than half as many as there are without
SPLITS = ("train", "val", "test")


class SourceError(ValueError):
    """A source that cannot be used; the message names it and what would do."""


@dataclass(frozen=True)
class Sample:
    """One clip, read: the motion, what it is called, and what its mirror image is called.

    `content` and `style` are empty where the source does not tell them apart.
    """

    motion: Motion
    captions: tuple[str, ...]
    mirrored: tuple[str, ...]
    licence: str
    content: str = ""
    style: str = ""


@dataclass(frozen=True)
class Clip:
    """A clip to be read: `name` is its own within the data set and the same on every machine; `file` as in its source.

    `load` raises ValueError or OSError where the file is bad. It is a function of a module with its arguments
    (`functools.partial`), for other processes to call. `stamp` changes when what the clip is made from does. `split` is
    that of its name unless its source says another.
    """

    name: str
    source: str
    file: str
    load: Callable[[], Sample]
    stamp: str = ""
    split: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "split", self.split or split_of(self.name))


def split_of(name: str) -> str:
    """ "train" (80 %), "val" (5 %) or "test" (15 %), by the hash of a clip's name: it never changes as clips come.

    Pieces of one clip (`name@start-end`) go together.
    """
    whole = name.partition("@")[0]
    twentieth = int.from_bytes(hashlib.sha256(whole.encode()).digest()[:4], "little") % 20
    return "val" if twentieth == 0 else "test" if twentieth <= 3 else "train"


def stamp(path: Path, captions: Sequence[str] = ()) -> str:
    """The stamp of a clip that is read from a file and called `captions`: the file's size and those words."""
    return hashlib.sha256("\n".join((str(path.stat().st_size), *captions)).encode()).hexdigest()[:16]


def told(motion: Motion, captions: tuple[str, ...], name: str, licence: str) -> Sample:
    """A clip that people have described: their captions, and its numbers in some of them."""
    captions = (*captions, *_numbered(captions, measure(motion), name))
    return Sample(motion, captions, tuple(map(swap_sides, captions)), licence)


def drawn(captions: Sequence[str], name: str, measured: Measured | None = None) -> tuple[str, ...]:
    """At most 24 of a grammar's `captions`, by hash; up to 8 of them with a number where the clip was `measured`.

    Clips of the training split get none that is kept for testing.
    """
    allowed = _by_hash(_allowed(captions, name), name)[:MOST_CAPTIONS]
    if measured is None:
        return allowed
    numbered = _numbered(allowed, measured, name)
    return allowed[: MOST_CAPTIONS - len(numbered)] + numbered


def _numbered(captions: Sequence[str], measured: Measured, name: str) -> tuple[str, ...]:
    """Some of `captions` with a measured number each; of seconds one, and only beside four captions or more."""
    said = [new for caption in captions for new in with_numbers(caption, measured)]
    said = list(_by_hash(_allowed(said, name), name))
    times = [c for c in said if says_time(c)]
    wanted = [c for c in said if c not in times] + times[: len(captions) >= 4]
    return tuple(wanted[: min(MOST_NUMBERED, (len(captions) + 1) // 2)])


def _allowed(captions: Sequence[str], name: str) -> list[str]:
    return [c for c in captions if split_of(name) != "train" or not kept_for_testing(c)]


def _by_hash(captions: Sequence[str], name: str) -> tuple[str, ...]:
    return tuple(sorted(dict.fromkeys(captions), key=lambda c: hashlib.sha256(f"{name} {c}".encode()).digest()))
