# ruff: noqa: E501 (the tables of a page have long rows)
"""Run the benchmarks and write what they print into docs/results.md and the model card.

python benchmarks/results.py runs/corpus.npz [--quick]
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tyro

from motiongen.features import FPS
from motiongen.weights import FOLDER, load_weights

ROOT = Path(__file__).parent.parent


def main(corpus: Annotated[Path, tyro.conf.Positional] = Path("runs/corpus.npz"), quick: bool = False) -> None:
    """Run every benchmark of the project and write the pages."""
    shorter = ["--quick"] if quick else []
    semantics = _run("semantics.py", str(corpus), *shorter)
    cold = _run("cold_start.py", *shorter)
    demo = _demo()
    when = f"{datetime.now(UTC):%Y-%m-%d}, {_machine()}{', --quick' if quick else ''}"
    _write(ROOT / "docs/results.md", _results(semantics, cold, demo, when))
    _write(ROOT / "docs/model-card.md", _card(semantics, when))


def _run(name: str, *args: str) -> dict[str, Any]:
    print(f"{name} {' '.join(args)} …", file=sys.stderr)
    done = subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / name), *args, "--json"],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _demo() -> str:
    """What `rigcast demo` prints."""
    print("rigcast demo …", file=sys.stderr)
    with tempfile.TemporaryDirectory() as room:
        done = subprocess.run(
            [sys.executable, "-m", "rigcast", "demo"], cwd=room, check=True, stdout=subprocess.PIPE, text=True
        )
    return "\n".join(line.rstrip() for line in done.stdout.rstrip().splitlines())


def _machine() -> str:
    return f"{platform.machine()} {platform.system()}, {os.cpu_count()} cores, no GPU used"


def _write(path: Path, text: str) -> None:
    temporary = path.with_suffix(".tmp")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)


def _by_content(s: dict[str, Any]) -> str:
    rows = [f"| {c} | {v['real']:.0%} | {v['generated']:.0%} |" for c, v in s["by_content"].items()]
    total = f"| **macro average** | **{s['real']:.1%}** | **{s['generated']:.1%}** |"
    return "\n".join(["| content | real clips | generated |", "|---|---:|---:|", *rows, total])


def _results(s: dict[str, Any], cold: dict[str, Any], demo: str, when: str) -> str:
    split = "\n".join(f"| {name} | {seconds:.2f} |" for name, seconds in cold["split_s"].items())
    return f"""# Results

Written by `python benchmarks/results.py` on {when}. Every figure is printed by a script in `benchmarks/`.

## Does the motion show what the text says?

`benchmarks/semantics.py`: a classifier trained on real clips judges {s["clips"]} clips generated from captions that no
model was trained on, and {s["real_held_out_clips"]} held-out real ones (half of them mirror images). Generated over
real, macro-averaged over contents with at least 12 clips: **{s["ratio"]:.3f}** (target 0.75) with {s["steps"]} passes of
{s["sampler"]}. The rare contents have four held-out clips each, so the judge is weak there; over the contents with at
least 100 clips alone the ratio is {s["ratio_common"]:.3f}.

{_by_content(s)}

Warned as unfamiliar: {s["warned_in_scope"]:.1%} of those captions, {s["warned_out_of_scope"]:.1%} of prompts about
something else.

## How long until something moves?

`benchmarks/cold_start.py`: `rigcast say`, from process start to the first frame on the wire, takes
**{cold["ratio"]:.2f} times** what importing torch takes alone (target {cold["target"]:g}), measured in turn in one run.
Nothing in it imports torch. Seconds of each stage in that run:

| stage | s |
|---|---:|
{split}

## From a sentence to servos

`rigcast demo`, in full: a wave, checked, filmed, streamed over ZeroMQ to a driver that turns twenty emulated servos
through the maker's SDK and a serial path. The error is that of each servo against its command a cycle before.

```
{demo}
```
"""


def _card(s: dict[str, Any], when: str) -> str:
    w = load_weights(FOLDER / "mdm.safetensors")
    millions = sum(v.size for v in w.tensors.values()) / 1e6
    lengths = "; ".join(f"{c} {t:g} s" for c, t in zip(w.bank.contents, w.bank.seconds, strict=True))
    return f"""# Model card: `mdm`

Text to human motion by diffusion, after the Motion Diffusion Model (Tevet et al. 2022): a transformer in decoder form
({millions:.2f} M parameters, {w.patch} frames a token, {w.heads} heads) that predicts the clean motion and listens to
every word by cross-attention. Written by `python benchmarks/results.py` on {when}.

| | |
|---|---|
| File | `motiongen/weights/mdm.safetensors`, half precision, {(FOLDER / "mdm.safetensors").stat().st_size / 1e6:.2f} MB, digest `{w.digest}` |
| Licence of the weights | {w.licence}: not for commercial use |
| Data | {w.training["data"]}, {w.training["clips"]} clips and their mirror images; one in eight held out |
| Captions | made from content and style by a grammar; one phrasing in ten kept for testing |
| Training | {w.training["steps"]} steps of {w.training["batch"]} crops of 3 to 6 s, AdamW, EMA 0.999, seed {w.training["seed"]}; `python -m motiongen.train` |
| Noise | cosine schedule in continuous time; {s["steps"]} passes of DPM-Solver++(2M), guidance {s["guidance"]}, both guidance passes in one batch |
| Output | 22 joints of SMPL at {FPS:g} frames/s, 1 to 60 s; beyond 6 s window by window |

## What it can do

Content right for {s["generated"]:.1%} of clips from captions never trained on, against {s["real"]:.1%} for held-out real
clips by the same judge: {s["ratio"]:.3f} of real; {s["ratio_common"]:.3f} over the contents with at least 100 clips.

{_by_content(s)}

## What it cannot

It knows {len(w.bank.contents)} contents and nothing else: {", ".join(w.bank.contents)}. Of those, call, respond, kick,
punch, slash and dance were seen in one or two clips each. Counts, angles and sequences ("three times", "then") are not
understood. A prompt far from its captions (cosine under {w.bank.known}) is warned about; prompts about something else are
caught in {s["warned_out_of_scope"]:.0%} of the cases tried, and {s["warned_in_scope"]:.1%} of good ones are warned about
for nothing. The data show three professional actors of one build; other ways of moving are not in it.

Usual lengths, taken where no `--seconds` is given: {lengths}.
"""


if __name__ == "__main__":
    tyro.cli(main)
