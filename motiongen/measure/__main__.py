"""Print what a motion in a file shows.

python -m motiongen.measure FILE
"""

from __future__ import annotations

import sys
from dataclasses import fields
from pathlib import Path

from motiongen.formats.reading import read_motion
from motiongen.measure.clip import measure
from motiongen.text.say_numbers import clauses


def main(path: Path) -> int:
    """Print what a motion in a file shows and what a caption may say of it; the exit code, 2 where it is unreadable."""
    try:
        found = measure(read_motion(path))
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    for field in fields(found):
        print(f"{field.name:16} {getattr(found, field.name):8.4g}")
    for clause in clauses(found):
        print(clause)
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m motiongen.measure FILE")
    sys.exit(main(Path(sys.argv[1])))
