"""Measure everything and write docs/results.md and the model card: no figure on those pages was typed.

python benchmarks/results.py runs [--quick]

Builds the data set in runs/data where it is not there yet (from the motion capture in RIGCAST_MOTION_DATA), trains the
evaluators, evaluates; what was done before is not done again.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
import tyro

sys.path.insert(0, str(Path(__file__).parent))
from evaluation import targets
from lines import text

from motiongen.candidates import DEFAULT_CANDIDATES
from motiongen.diffusion.weights import FOLDER, Weights, load_weights
from motiongen.evaluation.compare import Comparison, compare
from motiongen.evaluation.report.table import BY_CONTENT, cell, headings, table_rows
from motiongen.evaluation.run.results import Results, Subject, read_results
from motiongen.features import FPS
from motiongen.files import replacing

ROOT = Path(__file__).parent.parent
MODEL = "mdm"
OTHERS = ("motiondiffuse", "diffusionphase", "free")  # models that are held against it
SUBJECTS = ("real", MODEL, *OTHERS, "gestures", "retrieval", "mean-pose", "noise")
AFTER = {
    "mdm": "after the Motion Diffusion Model (Tevet et al. 2022): a transformer in decoder form that predicts the\n"
    "clean motion and listens to every word by cross-attention",
    "motiondiffuse": "after MotionDiffuse (Zhang et al. 2022): a cross-modality linear transformer that estimates the\n"
    "noise, its blocks styled by text and noise level ([motiondiffuse.md](motiondiffuse.md))",
    "diffusionphase": "after DiffusionPhase (Wan et al. 2023): a transformer that draws amplitudes, shifts and\n"
    "offsets of periodic phases, and an auto-encoder that makes motion of them\n"
    "([diffusionphase.md](diffusionphase.md))",
    "free": "the network of [mdm](model-card.md) with a layer less, trained only on motion that may be\n"
    "used commercially: CMU's clips, our own gestures, and what is composed of these",
}
RIG = "puppet"


def main(runs: Annotated[Path, tyro.conf.Positional] = Path("runs"), quick: bool = False) -> None:
    """Build, evaluate, and write the pages."""
    shorter = ["--quick"] if quick else []
    data, out = runs / "data", runs / "results"
    if not data.exists():
        _rigcast("data", "build", *_sources(), "--out", str(data))
    shared = ["--data", str(data), "--evaluators", str(out / "evaluators"), *shorter]
    single = _joined([_evaluated(name, out / name, shared) for name in SUBJECTS])
    several = _evaluated(MODEL, runs / "results-candidates", [*shared, "--candidates", str(DEFAULT_CANDIDATES)])
    cold = json.loads(_run(sys.executable, str(ROOT / "benchmarks/cold_start.py"), "--json", *shorter))
    _write(ROOT / "docs/results.md", results_page(single, several, cold, _demo(), quick=quick))
    _write(ROOT / "docs/model-card.md", card(MODEL, _together(single, several)))
    for name in OTHERS:
        _write(ROOT / f"docs/model-card-{name}.md", card(name, single))


def _evaluated(name: str, folder: Path, options: Sequence[str]) -> Results:
    """What `rigcast eval` finds of a subject; a folder that holds it already is believed."""
    if not (folder / "results.json").exists():
        _rigcast("eval", name, *options, "--out", str(folder), "--rig", RIG)
    return read_results(folder / "results.json")


def _joined(found: Sequence[Results]) -> Results:
    """Runs of one subject each as one run. Raises SystemExit where they were not asked the same."""
    first = found[0]
    for results in found:
        if any(getattr(results, part) != getattr(first, part) for part in ("plan", "data_digest", "judges", "seed")):
            raise SystemExit(f"{results.subjects[0].name} was not evaluated as the others were; delete its folder")
    texts = {digest: said for results in found for digest, said in results.texts.items()}
    subjects = tuple(subject for results in found for subject in results.subjects)
    return msgspec.structs.replace(first, date=max(r.date for r in found), texts=texts, subjects=subjects)


def _sources() -> list[str]:
    where = os.environ.get("RIGCAST_MOTION_DATA")
    if where is None:
        raise SystemExit("RIGCAST_MOTION_DATA is not set: the folder with Bandai-Namco's and CMU's BVH files")
    return [f"bandai-namco:{where}", f"cmu:{where}", "gestures:5000", "composed:2500"]


def _rigcast(*args: str) -> None:
    subprocess.run([sys.executable, "-m", "rigcast", *args], check=True)


def _run(*command: str, cwd: str | None = None) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=cwd).stdout


def _demo() -> str:
    """What `rigcast demo` prints."""
    with tempfile.TemporaryDirectory() as room:
        printed = _run(sys.executable, "-m", "rigcast", "demo", cwd=room)
    return "\n".join(line.rstrip() for line in printed.rstrip().splitlines())


def _write(path: Path, page: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _by_name(results: Results, name: str) -> Subject:
    return next(subject for subject in results.subjects if subject.name == name)


def _together(single: Results, several: Results) -> Results:
    """One table of both runs, the model with candidates beside the model without."""
    at = [subject.name for subject in single.subjects].index(MODEL) + 1
    subjects = (*single.subjects[:at], *several.subjects, *single.subjects[at:])
    return msgspec.structs.replace(single, subjects=subjects)


def _table(results: Results) -> str:
    names = headings(results)
    rows = [
        f"| **{row.cells[0]}** |{' |' * (len(names) - 1)}" if row.heading else _line(row.cells)
        for row in table_rows(results)
    ]
    return "\n".join((_line(names), "|---|" + "---:|" * (len(names) - 1), *rows))


def _line(cells: tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"


def _only(results: Results, names: Sequence[str]) -> Results:
    """Some of the subjects alone."""
    return msgspec.structs.replace(results, subjects=tuple(s for s in results.subjects if s.name in names))


def _trained() -> str:
    """What the models learnt from, and how long."""
    known = {name: load_weights(FOLDER / f"{name}.safetensors") for name in (MODEL, *OTHERS)}
    facts = list(dict.fromkeys(fact for w in known.values() for fact in w.training))
    rows = [_line((fact, *(str(w.training.get(fact, "–")) for w in known.values()))) for fact in facts]
    size = _line(("parameters, millions", *(f"{_millions(w):.2f}" for w in known.values())))
    return "\n".join((_line(("", *known)), "|---|" + "---:|" * len(known), size, *rows))


def _millions(weights: Weights) -> float:
    return sum(v.size for v in weights.tensors.values()) / 1e6


def _token(weights: Weights) -> str:
    return f"{weights.sizes['patch']} frames a token" if "patch" in weights.sizes else "a frequency a token"


def _beyond(weights: Weights) -> str:
    return "window by window" if "patch" in weights.sizes else "its primary segment is repeated"


def _contents(results: Results, names: tuple[str, ...]) -> str:
    """Content by content, for some subjects."""
    subjects = [_by_name(results, name) for name in names]
    contents = [figure.name for figure in subjects[-1].figures if figure.group == BY_CONTENT]
    rows = [_line((c, *(cell(subject.figure(BY_CONTENT, c)) for subject in subjects))) for c in contents]
    return "\n".join((_line(("content", *names)), "|---|" + "---:|" * len(names), *rows))


def _targets(results: Results) -> str:
    return "\n".join(text(line).partition(" ")[2].strip() for line in targets(results, MODEL))


def _compared(found: Comparison) -> str:
    rows = [
        _line(
            (
                f"{r.group}: {r.name}",
                str(r.n),
                f"{r.a:.3g}",
                f"{r.b:.3g}",
                f"{r.low:+.2g} … {r.high:+.2g}",
                f"{r.p:.2g}",
                r.verdict,
            )
        )
        for r in found.rows
    ]
    return "\n".join(
        (_line(("measure", "prompts", found.a, found.b, "difference", "p", "")), "|---|" + "---:|" * 5 + "---|", *rows)
    )


def results_page(single: Results, several: Results, cold: dict[str, Any], demo: str, *, quick: bool) -> str:
    """docs/results.md."""
    split = "\n".join(f"| {name} | {seconds:.2f} |" for name, seconds in cold["split_s"].items())
    both = _only(
        _together(single, several), [s.name for s in (*single.subjects, *several.subjects) if s.name not in OTHERS]
    )
    rival = _by_name(single, "retrieval")  # some targets are held against it
    beside = msgspec.structs.replace(several, subjects=(*several.subjects, rival))
    best = compare(single, _by_name(single, MODEL), several, _by_name(several, MODEL))
    plan, most = single.plan, DEFAULT_CANDIDATES
    note = ", with `--quick`: few prompts, wide intervals" if quick else ""
    return f"""# Results

Written by `benchmarks/results.py` from runs of `rigcast eval` on {single.date}, {single.machine}{note}.
No figure here was typed.

## What comes of a text?

`rigcast eval`, on up to {plan["clips"]} held-out captions and {plan["language"]} prompts a category of the language
tests; ± is half of the 95 % interval. [evaluation.md](evaluation.md) says what each measure is. `real` are held-out
clips: the ceiling. `best of {most}` draws up to {most} motions and keeps the one that measures right, as `rigcast say`
does{_older(single, several)}.
`retrieval` is the training clip with the nearest caption. A prompt that a generator refuses counts as wrong, and
as nobody moving: {_refusals(single)}.

{_table(both)}

## Against the targets

`benchmarks/evaluation.py`, `{MODEL}` alone:

```
{_targets(single)}
```

and the best of {most}:

```
{_targets(beside)}
```

## What do candidates gain?

Prompt by prompt (`rigcast eval compare`), one drawn against the best of up to {most}. {best.sentence}

{_compared(best)}

## The models side by side

The same measures on the same prompts; what each was trained on, by the same loop in the order of this table's columns:

{_trained()}

{_table(_only(single, ("real", MODEL, *OTHERS)))}

## Content by content

{_contents(single, ("real", MODEL, *OTHERS))}

## How long until something moves?

`benchmarks/cold_start.py`: `rigcast say`, from process start to the first frame on the wire, takes
**{cold["ratio"]:.2f} times** what importing torch takes alone (target {cold["target"]:g}), measured in turn in one run.
Nothing in it imports torch. Seconds of each stage in that run:

| stage | s |
|---|---:|
{split}

## From a sentence to servos

`rigcast demo`, in full: a wave, checked, filmed, streamed over ZeroMQ to a driver that turns twenty emulated servos
through a serial path. The error is that of each servo against its command a cycle before.

```
{demo}
```
"""


def _older(single: Results, several: Results) -> str:
    """Says so where the two runs drew with different code."""
    codes = [_by_name(results, MODEL).digest.split()[0] for results in (single, several)]
    return "" if codes[0] == codes[1] else f" (drawn by another state of the code, {codes[1]}; the rest by {codes[0]})"


def _refusals(results: Results) -> str:
    return ", ".join(f"{s.name} {s.refused}" for s in results.subjects if s.refused) or "none did"


def card(name: str, results: Results) -> str:
    """The model card of `name`, beside real clips and the nearest caption's."""
    file = FOLDER / f"{name}.safetensors"
    w = load_weights(file)
    shown = _only(
        results, [s.name for s in results.subjects if s.name in ("real", "retrieval") or s.name.startswith(name)]
    )
    short = "; ".join(line.name for line in targets(results, name) if not line.holds) or "none"
    about = "\n".join(f"| {fact} | {value} |" for fact, value in w.training.items())
    return f"""# Model card: `{name}`

Text to human motion by diffusion, {AFTER[name]}.
{_millions(w):.2f} M parameters, {_token(w)}, {w.sizes["heads"]} heads.

Written by `benchmarks/results.py` on {results.date}, {results.machine}; no figure here was typed.

| | |
|---|---|
| file | `motiongen/weights/{file.name}`, {file.stat().st_size / 1e6:.2f} MB, digest `{w.digest}` |
| licence of the weights | {w.licence} |
{about}
| output | 22 joints of SMPL at {FPS:g} frames/s, 1 to 60 s; beyond {w.window / FPS:g} s {_beyond(w)} |

## What it can do, and how well

Beside held-out real clips, and the training clip with the nearest caption. [results.md](results.md) has the rest.

{_table(shown)}

## What it cannot

Targets that it falls short of, one motion drawn for a prompt: {short}.

It was trained on {len(w.bank.contents)} contents and sources: {", ".join(w.bank.contents)}. What is far from its
captions (cosine under {w.bank.known}) is warned about; the table says how often rightly. The motion capture behind it
shows few actors of one build; other ways of moving are not in it.
"""


if __name__ == "__main__":
    tyro.cli(main)
