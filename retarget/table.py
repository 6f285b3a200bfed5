"""Strict reading of TOML tables: every key is asked for by type, and a key that nobody asked for is an error."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
REQUIRED: Any = object()


class RigError(ValueError):
    """A rig that is not there or whose file is wrong; the message names the file, the value and the good ones."""


class Table:
    """One table of a TOML file; `where` is its place in the words of an error, such as `rig.toml [sensors]`.

    Every reader takes the key, and a default where the key may be missing; all raise RigError in one line.
    """

    def __init__(self, data: dict[str, Any], where: str) -> None:
        self.data, self.where = data, where
        self.asked: list[str] = []

    def _read(self, key: str, default: Any, good: Callable[[Any], bool], what: str) -> Any:
        self.asked.append(key)
        if key not in self.data:
            if default is REQUIRED:
                raise RigError(f"{self.where}: key {key!r} is missing ({what})")
            return default
        if not good(self.data[key]):
            raise RigError(f"{self.where}: {key} = {self.data[key]!r} should be {what}")
        return self.data[key]

    def text(self, key: str, default: Any = REQUIRED) -> str:
        """A string that is not empty."""
        return self._read(key, default, lambda v: isinstance(v, str) and v != "", "a string")

    def choice(self, key: str, options: Sequence[str], default: Any = REQUIRED) -> Any:
        """One of `options`."""
        return self._read(key, default, lambda v: v in options, f"one of {', '.join(options)}")

    def flag(self, key: str, default: Any = REQUIRED) -> bool:
        """A boolean."""
        return self._read(key, default, lambda v: isinstance(v, bool), "true or false")

    def integer(self, key: str, low: int, high: int, default: Any = REQUIRED) -> int:
        """An integer within `low` and `high`, both included."""
        return self._read(key, default, lambda v: type(v) is int and low <= v <= high, f"an integer {low} to {high}")

    def number(self, key: str, default: Any = REQUIRED, *, positive: bool = False) -> float:
        """A finite number of at least 0, or above 0 where `positive`."""
        what = "a number above 0" if positive else "a number of at least 0"
        return float(self._read(key, default, lambda v: _number(v) and (v > 0 or (v == 0 and not positive)), what))

    def span(self, key: str) -> tuple[float, float]:
        """A pair `[lower, upper]` of finite numbers, lower below upper."""
        pair = self._read(
            key,
            REQUIRED,
            lambda v: isinstance(v, list) and len(v) == 2 and all(map(_number, v)) and v[0] < v[1],
            "[lower, upper] with lower below upper",
        )
        return float(pair[0]), float(pair[1])

    def pair(self, key: str) -> tuple[float, float]:
        """Two finite numbers."""
        good = self._read(
            key, REQUIRED, lambda v: isinstance(v, list) and len(v) == 2 and all(map(_number, v)), "two numbers"
        )
        return float(good[0]), float(good[1])

    def point(self, key: str) -> tuple[float, float, float]:
        """Three finite numbers."""
        good = self._read(
            key, REQUIRED, lambda v: isinstance(v, list) and len(v) == 3 and all(map(_number, v)), "three numbers"
        )
        return float(good[0]), float(good[1]), float(good[2])

    def numbers(self, key: str) -> dict[str, float]:
        """A table of finite numbers by name; empty where the key is missing."""
        good = self._read(
            key, {}, lambda v: isinstance(v, dict) and all(map(_number, v.values())), "a table of numbers by name"
        )
        return {name: float(value) for name, value in good.items()}

    def texts(self, key: str) -> tuple[str, ...]:
        """An array of at least one string."""
        return tuple(
            self._read(
                key,
                REQUIRED,
                lambda v: isinstance(v, list) and len(v) > 0 and all(isinstance(s, str) for s in v),
                "an array of strings",
            )
        )

    def table(self, key: str, read: Callable[[Table], T], default: Any = REQUIRED) -> T:
        """The sub-table `[key]`, read by `read`."""
        data = self._read(key, default, lambda v: isinstance(v, dict), "a table")
        return data if data is default else Table(data, f"{self.where} [{key}]").all(read)

    def tables(self, key: str, read: Callable[[Table], T]) -> tuple[T, ...]:
        """The array of tables `[[key]]`, each read by `read`; empty where the key is missing."""
        rows = self._read(
            key, [], lambda v: isinstance(v, list) and all(isinstance(r, dict) for r in v), "an array of tables"
        )
        return tuple(Table(row, f"{self.where} [[{key}]] {i + 1}").all(read) for i, row in enumerate(rows))

    def all(self, read: Callable[[Table], T]) -> T:
        """What `read` makes of this table; a key that it did not ask for is an error."""
        out = read(self)
        unknown = [key for key in self.data if key not in self.asked]
        if unknown:
            raise RigError(f"{self.where}: unknown key {unknown[0]!r}; known are {', '.join(self.asked)}")
        return out


def read_toml(path: Path) -> Table:
    """The whole file as a table; raises RigError where it cannot be read or is not TOML."""
    try:
        with path.open("rb") as file:
            return Table(tomllib.load(file), str(path))
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise RigError(f"{path}: {getattr(problem, 'strerror', None) or problem}") from None


def unique(values: Sequence[T], what: str) -> None:
    """Raises RigError where a value comes twice."""
    twice = [v for i, v in enumerate(values) if v in values[:i]]
    if twice:
        raise RigError(f"{what} {twice[0]!r} is given twice")


def known(name: str, names: Sequence[str], what: str) -> None:
    """Raises RigError where `name` is not one of `names`."""
    if name not in names:
        raise RigError(f"{what} {name!r} is unknown; known are {', '.join(names) or 'none'}")


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
