"""The report for people: one HTML page that needs nothing else, with tables, plots and stick figures that move."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from motiongen.evaluation.report.plots import COLOURS, plot
from motiongen.evaluation.report.table import BY_CONTENT, groups, headings, table_rows, title
from motiongen.evaluation.run.evaluate import Example
from motiongen.evaluation.run.results import Results
from motiongen.files import replacing
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion

FPS = 12  # of the stick figures
MOST_SECONDS = 6.0  # of each that the page shows
_HERE = Path(__file__).parent
_ABOUT = {
    "content": "A classifier trained on real clips says what a motion shows. Captions are of held-out clips.",
    BY_CONTENT: "The same, one content at a time: few prompts each, so wide intervals.",
    "language": "Prompts that nobody was trained on. Sides, counts, degrees, speed and order are measured, not judged.",
    "motion": "How the motions move, whatever they were to show.",
    "gate": "Share of motions that a rig can do: retargeted, then tracked in physics.",
    "speed": "Seconds of motion for each second of computing, on the machine named above.",
}
_EVALUATOR = (
    "The published measures, as this evaluator sees them. Evaluators disagree, so there are two: compare figures of "
    "one neither with those of another nor with those in papers."
)


def write_report(results: Results, examples: Sequence[Example], path: Path) -> None:
    """Write the page (under a temporary name first); raises OSError where it cannot be written."""
    with replacing(path) as temporary:
        temporary.write_text(page(results, examples), encoding="utf-8")


def page(results: Results, examples: Sequence[Example]) -> str:
    """The whole page as HTML."""
    clips = results.plan["clips"]
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'><title>Evaluation</title>"
        f"<style>{_read('report.css')}</style></head><body>",
        "<h1>Evaluation</h1>",
        f"<p class='faint'>{escape(results.date)} · data set {escape(results.data)} · {escape(results.machine)} · "
        f"seed {results.seed} · up to {clips} held-out captions, {results.plan['language']} prompts a category. "
        "↑ more is better, ↓ less is. Bars and ± are 95 % intervals.</p>",
        _key(results),
        _figures(examples),
        *(_group(results, group, names) for group, names in groups(results).items()),
        "<h2>All figures</h2>",
        _table(results),
        _judges(results),
        f"<script>const PARENTS = {list(SMPL_PARENTS)}, FPS = {FPS}, HEAD = {SMPL_JOINTS.index('head')}, "
        f"SIDES = {[name[0] if name.startswith(('left', 'right')) else '-' for name in SMPL_JOINTS]};\n"
        f"{_read('report.js')}</script></body></html>\n",
    ]
    return "\n".join(parts)


def _read(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")


def _key(results: Results) -> str:
    rows = "".join(
        f"<li><i style='background:var(--c{i % COLOURS})'></i>{escape(title(s.name, s.candidates))}"
        f"{f' <span class=faint>refused {s.refused} prompts</span>' if s.refused else ''}</li>"
        for i, s in enumerate(results.subjects)
    )
    return f"<ul class='key'>{rows}</ul>"


def _group(results: Results, group: str, names: Sequence[str]) -> str:
    about = _ABOUT.get(group, _EVALUATOR if group.startswith("evaluator ") else "")
    plots = "".join(plot(name, [s.figure(group, name) for s in results.subjects]) for name in names)
    heading = escape(group[:1].upper() + group[1:])
    inside = f"<p class='faint'>{escape(about)}</p>{_key(results)}<div class='plots'>{plots}</div>"
    if group == BY_CONTENT:
        return f"<h2>{heading}</h2><details><summary>{len(names)} contents</summary>{inside}</details>"
    return f"<h2>{heading}</h2>{inside}"


def _table(results: Results) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in headings(results))
    body = "".join(
        f"<tr class='group'><th colspan='{len(row.cells)}'>{escape(row.cells[0])}</th></tr>"
        if row.heading
        else "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row.cells) + "</tr>"
        for row in table_rows(results, every_content=True)
    )
    return f"<div class='wide'><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


def _judges(results: Results) -> str:
    judges = ", ".join(f"{name} {digest}" for name, digest in results.judges.items())
    subjects = "; ".join(f"{s.name} {s.digest} ({s.licence})" for s in results.subjects)
    return f"<p class='faint'>Judges: {escape(judges)}. Subjects: {escape(subjects)}.</p>"


def _figures(examples: Sequence[Example]) -> str:
    """Prompt by prompt what each subject made of it."""
    by_text: dict[str, list[Example]] = {}
    for example in examples:
        by_text.setdefault(example.text, []).append(example)
    rows = "".join(
        f"<p class='said'>{escape(text)}</p><div class='clips'>{''.join(map(_clip, each))}</div>"
        for text, each in by_text.items()
    )
    note = "Left limbs are orange, right ones blue. Drag a figure to look from another side."
    return f"<h2>Look</h2><p class='faint'>{note} <button type='button'>Pause</button></p>{rows}"


def _clip(example: Example) -> str:
    said = escape(f"{example.subject}: {example.text}", quote=True)
    return (
        f"<figure class='clip'><canvas role='img' aria-label='{said}' "
        f"data-joints='{_joints(example.motion)}'></canvas>"
        f"<figcaption>{escape(example.subject)}</figcaption></figure>"
    )


def _joints(motion: Motion) -> str:
    """Joints of the first seconds in whole millimetres, int16, base64."""
    where = motion.resampled(FPS).positions()[: round(MOST_SECONDS * FPS) + 1]
    return b64encode(np.clip(np.round(where * 1000), -32768, 32767).astype("<i2").tobytes()).decode()
