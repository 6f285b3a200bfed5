"""What an evaluation found, as one JSON file: figures with intervals, every prompt's outcome, and who judged."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Literal

import msgspec

from motiongen.files import replacing

VERSION = 1
Better = Literal["more", "less", ""]


class ResultsError(ValueError):
    """A results file that cannot be read, or two that cannot be compared; the message says why."""


class Figure(msgspec.Struct, frozen=True):
    """One figure over `n` things, with its 95 % interval from `low` to `high`; `better` is the way to improve it."""

    group: str
    name: str
    value: float
    low: float
    high: float
    n: int
    unit: str = ""
    better: Better = ""


class Items(msgspec.Struct, frozen=True):
    """One measure prompt by prompt: `values[i]` of text i of `Results.texts[texts]`, None where it has none.

    `share`: whether the values are 1 (right) and 0 (wrong), not amounts.
    """

    group: str
    name: str
    texts: str
    values: tuple[float | None, ...]
    share: bool
    better: Better = ""


class Subject(msgspec.Struct, frozen=True):
    """What was evaluated. `digest` tells its weights or files; `candidates`: how many were drawn to keep one of;
    `refused`: prompts that it would not take, which count as wrong, and as nobody moving."""

    name: str
    digest: str
    licence: str
    candidates: int
    refused: int
    figures: tuple[Figure, ...]
    items: tuple[Items, ...]

    def figure(self, group: str, name: str) -> Figure | None:
        """The figure of that name, or None where it was not measured."""
        return next((f for f in self.figures if (f.group, f.name) == (group, name)), None)


class Results(msgspec.Struct, frozen=True):
    """One run of the evaluation. `judges`: digests of the evaluators and classifiers by name. `texts`: lists of prompts
    by their digest (`digest_of`)."""

    version: int
    date: str
    machine: str
    data: str
    data_digest: str
    plan: dict[str, int | dict[str, int]]
    seed: int
    judges: dict[str, str]
    texts: dict[str, tuple[str, ...]]
    subjects: tuple[Subject, ...]


def digest_of(texts: Sequence[str]) -> str:
    """16 hex digits over a list of texts."""
    return sha256(msgspec.json.encode(list(texts))).hexdigest()[:16]


def file_digest(path: Path) -> str:
    """16 hex digits over a file; raises OSError where it cannot be read."""
    return sha256(path.read_bytes()).hexdigest()[:16]


def write_results(results: Results, path: Path) -> None:
    """Write the file (under a temporary name first); raises OSError where it cannot be written."""
    with replacing(path) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(results), indent=1) + b"\n")


def read_results(path: Path) -> Results:
    """Read what `write_results` wrote; raises ResultsError where it is something else, OSError where there is none."""
    try:
        results = msgspec.json.decode(path.read_bytes(), type=Results)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ResultsError(f"{path}: not the results.json of an evaluation ({error})") from None
    if results.version != VERSION:
        raise ResultsError(f"{path}: version {results.version}, this rigcast reads {VERSION}; evaluate anew")
    return results
