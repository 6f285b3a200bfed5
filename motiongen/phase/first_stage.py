"""The auto-encoder of a finished first stage, as the second stage and its weights file take it over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path

from motiongen.diffusion.batches import Batches
from motiongen.diffusion.checkpoint import CHECKPOINT, read_checkpoint
from motiongen.diffusion.configs import DiffusionPhaseConfig, PhaseAutoencoderConfig
from motiongen.diffusion.run_folder import Run, RunError, read_run
from motiongen.nn import Tensors
from motiongen.phase.codes import Codes, open_codes
from motiongen.phase.phase_run import encode
from motiongen.phase.phases import Layout


@dataclass(frozen=True)
class FirstStage:
    """`sizes` and averaged `tensors` of an auto-encoder, and the `run` that made it."""

    sizes: PhaseAutoencoderConfig
    tensors: Tensors
    run: Run

    @property
    def layout(self) -> Layout:
        return Layout(self.sizes.highest, self.sizes.phases, self.sizes.cosine)


def read_first_stage(folder: Path) -> FirstStage:
    """The auto-encoder of the run in `folder`.

    Raises RunError where that is no run of one, CheckpointError where it has no checkpoint.
    """
    run = read_run(folder)
    network = PhaseAutoencoderConfig.network
    if run.config["network"] != network:
        raise RunError(f"{folder}: a run of {run.config['network']}, not of {network}; train that first")
    known = {field.name for field in fields(PhaseAutoencoderConfig)}
    sizes = PhaseAutoencoderConfig(**{k: v for k, v in run.config["model"].items() if k in known})
    found = read_checkpoint(folder / CHECKPOINT)
    tensors = {k.removeprefix("average."): v.numpy() for k, v in found.items() if k.startswith("average.")}
    return FirstStage(sizes, tensors, run)


def open_all_codes(
    sizes: DiffusionPhaseConfig, out: Path, batches: Batches, seed: int, progress: Callable[[int, int], None]
) -> Codes:
    """The codes that the run in `out` learns from, encoded by its first stage where they are not there yet."""
    first = read_first_stage(Path(sizes.autoencoder))
    how = partial(encode, first.tensors, first.layout)
    return open_codes(out, batches, first.layout, how, count=sizes.codes, seed=seed, progress=progress)
