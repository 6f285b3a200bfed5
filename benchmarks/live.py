"""The live generator: its speed against real time, what answering takes as a client sees it, an hour of it.

    python benchmarks/live.py [--quick] [--json] [--gate] [--part speed|ways|each|line|client|hour|steer|offline]

Times are wall time on whatever else the machine does, processor time where it says so; `cores` and `load` say how many
there are and how many programs want one. Targets are for two idle cores.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from lines import Line, gate, text
from live_client import answers
from live_hour import hour
from live_steer import steered

from motiongen.diffusion.weights import FOLDER
from motiongen.features import FPS
from motiongen.live.generator import LiveGenerator

WEIGHTS = FOLDER / "live.safetensors"
RIG = "puppet"
GENERATOR, WHOLE_LINE, P50_S, P95_S, SHARE, ALIKE = 25.0, 3.0, 0.4, 0.8, 0.8, 2.0
MDM_PASSES, MDM_FRAMES = 50, 196  # Tevet et al. 2022: sizes of the paper; passes as it is used since


@dataclass
class Found:
    """What one run of the benchmark measured: lines with targets, and figures without."""

    lines: list[Line] = field(default_factory=list)
    figures: dict[str, object] = field(default_factory=dict)


def main() -> int:
    """Print the table; exit 1 with `--gate` where a target is missed."""
    parts: dict[str, Callable[[Path, bool, Found], None]] = {
        "speed": speed,
        "ways": each_way,
        "each": each_frame,
        "line": whole_line,
        "client": client,
        "hour": long_run,
        "steer": steer,
        "offline": offline,
    }
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    parser.add_argument("--part", choices=parts, help="one part alone")
    parser.add_argument("--weights", type=Path, default=WEIGHTS, help="of the live generator")
    options = parser.parse_args()
    found = Found(figures={"cores": os.cpu_count(), "load": round(os.getloadavg()[0], 1)})
    for name, part in parts.items():
        if options.part in (None, name):
            part(options.weights, options.quick, found)
    if options.json:
        print(json.dumps({"lines": [asdict(line) | {"holds": line.holds} for line in found.lines], **found.figures}))
    else:
        print("\n".join(text(line) for line in found.lines))
        print("\n".join(f"{name}: {value}" for name, value in found.figures.items()))
    return gate(found.lines, options.gate)


def speed(weights: Path, quick: bool, found: Found) -> None:
    """Seconds of motion that the generator alone makes in a second."""
    live = LiveGenerator(weights)
    live.say("walk forward")
    live.next_chunk()
    count, first, began, busy = (8 if quick else 40), live.frame, time.perf_counter(), time.process_time()
    for _ in range(count):
        live.next_chunk()
    took, busy = time.perf_counter() - began, time.process_time() - busy
    times = (live.frame - first) / FPS / took
    found.figures["generator_times_by_processor_time"] = round((live.frame - first) / FPS / busy, 1)
    found.lines.append(Line("generator", "times real time", times, GENERATOR, at_least=True))
    found.figures["chunk_ms"] = 1e3 * took / count


def _median_ms(run: Callable[[], object], repeats: int) -> float:
    run()
    took = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        took.append(time.perf_counter() - began)
    return 1e3 * sorted(took)[len(took) // 2]


def each_way(weights: Path, quick: bool, found: Found) -> None:
    """What a pass of the network takes in each way there is to run it."""
    from live_ways import ways

    found.figures["pass"] = ways(weights, quick)


def each_frame(weights: Path, quick: bool, found: Found) -> None:
    """What it costs and changes that several frames go out of each solution of retargeting."""
    from live_each import each_solution

    found.figures["frames_a_solution"] = each_solution(weights, RIG, quick)


def whole_line(weights: Path, quick: bool, found: Found) -> None:
    """Generate, retarget and gate without waiting: seconds of motion a second, and the split; and what the gate says of
    all that it admitted, as one motion."""
    import numpy as np

    from retarget.rig import load_rig
    from retarget.trajectory import Trajectory
    from rigcast.service.line import FPS as WIRE
    from rigcast.service.line import Line as Live
    from sim.checks import check

    rig = load_rig(RIG)
    line = Live(LiveGenerator(weights), rig)
    rows = [line.make().qpos]
    line.work.seconds.clear()
    prompts = ("wave with the right hand", "bow", "raise both arms", "nod")
    first, began, busy, seconds = line.frame, time.perf_counter(), time.process_time(), (4 if quick else 40)
    for i in range(seconds // 4 or 1):
        line.say(prompts[i % len(prompts)], line.frame)
        until = line.frame + 4 * WIRE
        while line.frame < until:
            rows.append(line.make().qpos)
    took, busy = time.perf_counter() - began, time.process_time() - busy
    made = (line.frame - first) / WIRE
    found.figures["line_processor_s_a_second"] = round(busy / made, 3)
    report = check(Trajectory(np.concatenate(rows), WIRE, rig.name, rig.joint_names()), rig)
    found.lines.append(Line("line", "times real time, all stages", made / took, WHOLE_LINE, at_least=True))
    found.lines.append(Line("line", "checks that all of it fails", len(report.failures()), 0, at_least=False))
    found.figures["line_s_a_second"] = {k: round(v / made, 3) for k, v in line.work.seconds.items()}
    found.figures["line_refused"] = line.work.refused
    found.figures["line_failures"] = [failure.advice for failure in report.failures()]


def client(weights: Path, quick: bool, found: Found) -> None:
    """From a prompt's newline to 10 % of the arm's move, as somebody sees it who follows the stream."""
    took = sorted(answers(weights, RIG, 4 if quick else 24))
    found.figures["client_prompts"] = len(took)
    p50, p95 = (took[int(q * len(took))] for q in (0.5, 0.95))
    found.lines.append(Line("client", "s from prompt to 10 % of the move, p50", p50, P50_S, at_least=False))
    found.lines.append(Line("client", "s from prompt to 10 % of the move, p95", p95, P95_S, at_least=False))


def long_run(weights: Path, quick: bool, found: Found) -> None:
    """An hour with 500 random prompts, time-compressed, of the generator alone."""
    seen = hour(weights, minutes=1 if quick else 60, prompts=8 if quick else 500)
    lines = (
        ("frames that are not finite", seen.not_finite, 0, False),
        ("prompts that nothing moved at", seen.still, 0, False),
        ("distance of last to first part, times that by chance", seen.drift, ALIKE, False),
        ("recognised, as a share of what the offline model reaches", seen.share, SHARE, True),
    )
    found.lines += [Line("hour", *line) for line in lines]
    found.figures["hour"] = asdict(seen)


def steer(weights: Path, quick: bool, found: Found) -> None:
    """Errors of what is steered, heard by the network or overwritten in what it draws."""
    found.figures["steering"] = steered(weights, 1 if quick else 9)


def offline(weights: Path, quick: bool, found: Found) -> None:
    """Beside it, MDM as published: 50 passes of the paper's sizes over one clip, untrained, which takes as long."""
    import torch

    from motiongen.diffusion.configs import MdmConfig
    from motiongen.diffusion.mdm import Mdm
    from motiongen.diffusion.named_configs import CONFIGS

    sizes = MdmConfig(**asdict(CONFIGS["mdm-paper"].model))
    torch.set_num_threads(1)
    network = Mdm(sizes).eval()
    x, mask = torch.zeros(2, MDM_FRAMES, sizes.features), torch.ones(2, MDM_FRAMES, dtype=torch.bool)
    words, heard = torch.zeros(2, 8, sizes.text), torch.ones(2, 8, dtype=torch.bool)
    keep = torch.tensor([True, False])
    with torch.inference_mode():
        one = _median_ms(
            lambda: network(x, torch.full((2,), 0.5), mask, words, heard, words[:, 0], keep), 1 if quick else 5
        )
    live = LiveGenerator(weights)
    live.say("walk forward")
    began = time.perf_counter()
    chunk = live.next_chunk()
    took = time.perf_counter() - began
    whole = MDM_PASSES * one / 1e3
    found.figures["first_frame_s"] = {"live": round(took, 3), f"MDM, {MDM_PASSES} passes": round(whole, 2)}
    found.figures["seconds_of_motion_a_second"] = {
        "live": round(len(chunk) / FPS / took, 1),
        f"MDM, {MDM_PASSES} passes": round(MDM_FRAMES / 20 / whole, 2),
    }


if __name__ == "__main__":
    sys.exit(main())
