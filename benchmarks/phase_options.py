"""What the parts of `phase.py` are given, and the held-out clips that several of them ask for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motiongen.data.dataset import Dataset, open_dataset
from motiongen.diffusion.weights import FOLDER
from motiongen.evaluation.judges.judge import Judge, load_judge
from motiongen.evaluation.judges.sanity import held_out
from motiongen.evaluation.judges.seen import MOST_SECONDS
from motiongen.evaluation.protocol import Clips
from motiongen.generator import MIN_SECONDS, WEIGHTS_SUFFIX


@dataclass(frozen=True)
class Options:
    """The command line of `phase.py`."""

    part: list[str] | None
    generator: str
    data: Path | None
    evaluators: Path | None
    steps: int
    runs: Path | None
    quick: bool
    json: bool
    gate: bool

    @property
    def weights(self) -> Path:
        """The file of the generator's weights."""
        path = Path(self.generator)
        return path if path.suffix == WEIGHTS_SUFFIX else FOLDER / f"{self.generator}{WEIGHTS_SUFFIX}"

    @property
    def dataset(self) -> Dataset:
        """Raises SystemExit where none is named."""
        if self.data is None:
            raise SystemExit("phase.py: this part needs --data, a built data set")
        return open_dataset(self.data)

    @property
    def judge(self) -> Judge:
        """The judge `guo`. Raises SystemExit where no folder of judges is named."""
        if self.evaluators is None:
            raise SystemExit("phase.py: this part needs --evaluators, the folder of the data set's judges")
        return load_judge(self.evaluators / "guo" / "judge.safetensors")


def halves(data: Dataset, count: int) -> tuple[Clips, Clips]:
    """Two sets of `count` held-out clips of 1 to 8 s with different captions each: to hold against, and to ask for."""
    tested = held_out(data)
    order = np.random.default_rng(0).permutation(len(tested.captions))
    found: tuple[list[int], list[int]] = ([], [])
    said: tuple[set[str], set[str]] = (set(), set())
    for number, row in enumerate(order):
        motion, caption = tested.motions[row], tested.captions[row]
        half = number % 2
        if MIN_SECONDS <= motion.duration <= MOST_SECONDS and caption not in said[half] and len(found[half]) < count:
            found[half].append(int(row))
            said[half].add(caption)
    first, second = (
        Clips(*(tuple(each[i] for i in rows) for each in (tested.motions, tested.captions))) for rows in found
    )
    return first, second
