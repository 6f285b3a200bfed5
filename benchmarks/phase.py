"""Does DiffusionPhase do what its paper promises, on our corpus?

    python benchmarks/phase.py [--part NAME ...] [--data DIR] [--evaluators DIR] [--quick] [--json] [--gate]

Every part prints a table to read and the figures that are held to a target:

    exact         an analytic periodic motion through an auto-encoder that is fitted to it; repetition; blending
    lengths       held-out clips and texts, 1 to 5 times as long: the paper's Figure 4
    transitions   joins that begin in the last pose, in another's and in any: Sec. 4.4
    encodings     highest frequency, sines or cosines too, number of phases: Table 2 (trains an auto-encoder for each)

All but `exact` need a built data set; `lengths` and `encodings` also its judges.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

from lines import gate, text
from parts import Part, as_json, columns
from phase_encodings import encodings
from phase_exact import exact
from phase_lengths import lengths
from phase_options import Options
from phase_transitions import transitions

PARTS: dict[str, Callable[[Options], Part]] = {
    "exact": exact,
    "lengths": lengths,
    "transitions": transitions,
    "encodings": encodings,
}


def main() -> int:
    """Print the parts' tables; exit 1 with `--gate` where a target falls short."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", action="append", choices=PARTS, help="this part alone; repeatable")
    parser.add_argument("--generator", default="diffusionphase", help="its name, or a file of weights")
    parser.add_argument("--data", type=Path, help="a built data set")
    parser.add_argument("--evaluators", type=Path, help="folder of the judges trained on it")
    parser.add_argument("--steps", type=int, default=600, help="training steps of each auto-encoder of encodings")
    parser.add_argument("--runs", type=Path, help="where those are kept; without, they are not")
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed or was not measured")
    options = Options(**vars(parser.parse_args()))
    found: dict[str, Part] = {}
    for name in options.part or PARTS:
        found[name] = PARTS[name](options)
        if not options.json:
            print("\n".join([name, "", *columns(found[name].rows), "", *map(text, found[name].lines), ""]), flush=True)
    if options.json:
        print(json.dumps({name: as_json(part) for name, part in found.items()}, indent=1))
    return gate([line for part in found.values() for line in part.lines], options.gate)


if __name__ == "__main__":
    sys.exit(main())
