"""What an import loads, each seen in a process of its own: small computers install and load only what they need."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LIGHT = (
    "motiongen.motion",
    "motiongen.files",
    "motiongen.formats.bvh",
    "motiongen.formats.bvh_write",
    "motiongen.generator",
    "motiongen.data.build",
    "motiongen.evaluation.protocol",
    "motiongen.evaluation.physical",
    "motiongen.measure.clip",
    "motiongen.text.say_numbers",
    "motiongen.gestures.generator",
    "motiongen.phase.generator",
    "retarget.rig",
    "retarget.trajectory",
    "retarget.files",
    "sim.report",
)
PACKAGES = sorted(
    ".".join(path.parent.relative_to(ROOT).parts)
    for top in ("motiongen", "retarget", "sim", "drivers", "rigcast")
    for path in (ROOT / top).rglob("__init__.py")
)
VERBS = (
    "say",
    "play",
    "check",
    "view",
    "drive",
    "bus",
    "demo",
    "data",
    "evaluate",
    "listing",
    "rigs",
    "serve",
    "send",
    "bridge",
    "mirror",
    "train",
    "watching",
    "driving",
    "setting_up",
)


def modules(folder: str) -> list[str]:
    """Every module of a package."""
    return sorted(f"{folder}.{path.stem}" for path in (ROOT / folder).glob("*.py") if path.stem != "__init__")


def loaded_by(*names: str) -> set[str]:
    """Top-level packages that are loaded once `names` are imported."""
    code = f"import sys, {', '.join(names)}; print(*{{n.partition('.')[0] for n in sys.modules}})"
    run = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    return set(run.stdout.split())


def test_drivers_load_neither_torch_nor_mujoco() -> None:
    assert not loaded_by(*modules("drivers")) & {"torch", "mujoco", "mink", "scipy"}


def test_retarget_and_sim_load_no_torch() -> None:
    assert not loaded_by(*modules("retarget"), *modules("sim")) & {"torch", "transformers", "viser"}


def test_light_types_load_nothing_heavy() -> None:
    assert not loaded_by(*LIGHT) & {"torch", "mujoco", "mink", "scipy", "zmq", "rich"}


def test_parsers_load_nothing_heavy() -> None:
    assert not loaded_by("rigcast.__main__", *(f"rigcast.{v}" for v in VERBS)) & {
        "torch",
        "mujoco",
        "mink",
        "scipy",
        "PIL",
    }


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_export_nothing(package: str) -> None:
    assert not loaded_by(package) & {"numpy"}


def test_every_python_file_is_in_the_wheel() -> None:
    packages = {"motiongen", "retarget", "sim", "drivers", "rigcast"}
    skipped = {"tests", "benchmarks"}
    folders = {p.relative_to(ROOT).parts[0] for p in ROOT.glob("*/*.py") if not p.parts[-2].startswith(".")}
    assert folders <= packages | skipped
