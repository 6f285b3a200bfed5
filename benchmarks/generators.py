"""Do the diffusion models do what their papers promise?

    python benchmarks/generators.py [--part NAME ...] [--generator NAME] [--data DIR] [--quick] [--json] [--gate]

Every part prints a table to read and the figures that are held to a target:

    samplers    how far each sampler is from a distribution whose exact denoiser it is given
    attention   efficient attention against its equation, and its cost against quadratic attention's
    mixing      mixed noise against the equations for parts of the body and intervals of time
    editing     what stays in an edited clip, and the seams of what is drawn anew
    timeline    a story of four lines: what is seen when
    said        sides, counts, degrees, paces, several things: the network alone, put right, the best of a few
    pairs       a gait and something for the arms that were never trained on together (with --data)
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

from as_said import as_said
from attention import attention
from editing import editing, timeline
from held_out_pairs import pairs
from lines import gate, text
from noise_mixing import mixing
from parts import Options, Part, as_json, columns
from sampler_errors import samplers

PARTS: dict[str, Callable[[Options], Part]] = {
    "samplers": samplers,
    "attention": attention,
    "mixing": mixing,
    "editing": editing,
    "timeline": timeline,
    "said": as_said,
    "pairs": pairs,
}


def main() -> int:
    """Print the parts' tables; exit 1 with `--gate` where a target falls short."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", action="append", choices=PARTS, help="this part alone; repeatable")
    parser.add_argument("--generator", default="mdm", help="a diffusion generator's name, or a file of weights")
    parser.add_argument("--data", type=Path, help="a built data set, for pairs")
    parser.add_argument("--quick", action="store_true", help="about a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed or was not measured")
    options = parser.parse_args()
    found: dict[str, Part] = {}
    for name in options.part or PARTS:
        found[name] = PARTS[name](Options(options.quick, options.generator, options.data))
        if not options.json:
            print("\n".join([name, "", *columns(found[name].rows), "", *map(text, found[name].lines), ""]), flush=True)
    if options.json:
        print(json.dumps({name: as_json(part) for name, part in found.items()}, indent=1))
    return gate([line for part in found.values() for line in part.lines], options.gate)


if __name__ == "__main__":
    sys.exit(main())
