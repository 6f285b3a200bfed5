"""`rigcast train` and `rigcast train export`: train a generator on a data set, and make a weights file of it."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from motiongen.diffusion.configs import TrainConfig
from motiongen.diffusion.named_configs import named

DEFAULT = "mdm"


def train(
    *,
    data: Path,
    generator: str = DEFAULT,
    out: Path | None = None,
    config: Annotated[TrainConfig, tyro.conf.arg(name=""), tyro.conf.AvoidSubcommands],
) -> int:
    """Train a generator on a data set; the same command goes on where it was stopped. See docs/training.md.

    Args:
        data: Folder of a data set (`rigcast data build`).
        generator: mdm, free, motiondiffuse, live, phase-autoencoder, diffusionphase (after that), mdm-paper,
            mdm-decoder-paper or motiondiffuse-paper; all other options are as it has them, unless they are given.
        out: Folder of the run, by default runs/GENERATOR.
        config: The run.
    """
    from motiongen.data.dataset import open_dataset
    from motiongen.diffusion.train import train as run
    from rigcast.watching import watching

    folder = out or Path("runs") / generator
    dataset = open_dataset(data)
    with watching(folder) as watch:
        run(config, dataset, folder, watch)
    return 0


def export(run: Positional[Path], /, *, data: Path, out: Path, eight_bits: bool = False) -> int:
    """Write the weights file of a training run's last checkpoint.

    Args:
        run: Folder of the run.
        data: Folder of the data set that it was trained on.
        out: The file, .safetensors.
        eight_bits: Matrices in 8 bits a number, a file half as large, instead of half precision.
    """
    from motiongen.data.dataset import open_dataset
    from motiongen.diffusion.export import export as make

    if out.suffix != ".safetensors" or not out.absolute().parent.is_dir():
        raise ValueError(f"{out}: must be a .safetensors file in a folder that is there")
    made = make(open_dataset(data), run, out, eight_bits=eight_bits)
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB, {made.digest}, {made.training['steps']} steps; {made.licence}")
    return 0


def config_in(args: Sequence[str]) -> TrainConfig:
    """The config of the generator that a command line names."""
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--generator", nargs="?", default=DEFAULT, const=DEFAULT)
    return named(parser.parse_known_args(list(args))[0].generator)
