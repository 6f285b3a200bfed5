"""What the parts of `generators.py` are given; what they, and those of `phase.py`, hand back, and how it is shown."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from lines import Line

from motiongen.diffusion.weights import FOLDER
from motiongen.generator import WEIGHTS_SUFFIX


@dataclass(frozen=True)
class Options:
    """`quick`: all parts together about a minute on one core. `generator`: the name of a diffusion generator, or a
    file of weights; `data`: a built data set, for what needs one."""

    quick: bool
    generator: str = "mdm"
    data: Path | None = None

    @property
    def weights(self) -> Path:
        """The file of the generator's weights."""
        path = Path(self.generator)
        return path if path.suffix == WEIGHTS_SUFFIX else FOLDER / f"{self.generator}{WEIGHTS_SUFFIX}"


@dataclass(frozen=True)
class Part:
    """What one part found: `rows` to read, the first the columns' heads, and `lines` that are held to a target."""

    rows: tuple[tuple[str, ...], ...]
    lines: tuple[Line, ...]


def columns(rows: tuple[tuple[str, ...], ...]) -> list[str]:
    """Rows with their columns below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def as_json(part: Part) -> dict[str, object]:
    """A part with each line's verdict."""
    return {"rows": part.rows, "lines": [asdict(line) | {"holds": line.holds} for line in part.lines]}
