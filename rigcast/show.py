"""What a person or a program reads on stdout: the report, the times, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rigcast.pipeline import Take
from sim.report import Check, Report

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

PLAIN_WIDTH = 120  # columns where stdout is no terminal


def console() -> Console:
    """Rich on stdout; in a pipe or a file lines are not cut at 80 columns."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH, highlight=False, soft_wrap=False)


def new_table(*columns: str, title: str = "") -> Table:
    """An empty table in the one style of all of ours."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    return Table(*columns, title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)


def report_table(report: Report) -> Table:
    """The report, one row a check, with the figure, its limit and, where it failed, what to do."""
    verdict = "[green]pass[/]" if report.ok else "[red]fail[/]"
    title = f"{report.rig} on {report.mount}, {report.controller}: {verdict} (report {report.report_id})"
    if report.trials is not None:
        title += f"\n{report.trials.text}"
    table = new_table("check", "found", "limit", "unit", "", title=title)
    for column in (1, 2):
        table.columns[column].justify = "right"
    for check in report.checks:
        table.add_row(check.name, check.found, f"{check.limit:.4g}", check.unit, _verdict(check))
    return table


def _verdict(check: Check) -> str:
    if not check.applies:
        return "[dim]does not apply[/]"
    if check.ok:
        return "[green]ok[/]"
    from rich.markup import escape

    return f"[red]{escape(check.advice)}[/]"


def times_line(seconds: Mapping[str, float]) -> str:
    """Every stage with its seconds, and their sum."""
    parts = ", ".join(f"{name} {spent:.2f}" for name, spent in seconds.items())
    return f"{sum(seconds.values()):.2f} s: {parts}"


def origin_line(take: Take) -> str:
    """Which generator or file, weights, seed and licence stand behind a take."""
    source = take.trajectory.source
    weights = f", weights {source.weights}" if source.weights else ""
    seed = "" if source.seed is None else f", seed {source.seed}"
    return f"from {source.generator}{weights}{seed}; licence: {source.licence or 'not stated'}"


def size_line(take: Take) -> str:
    """How long the trajectory is and for which rig."""
    t = take.trajectory
    return f"{t.duration:.1f} s, {len(t)} frames at {t.fps:g} fps for {t.rig} ({len(t.joints)} joints)"


def take_dict(take: Take) -> dict[str, Any]:
    """The take as plain data for JSON."""
    t = take.trajectory
    return {
        "rig": t.rig,
        "duration_s": t.duration,
        "frames": len(t),
        "fps": t.fps,
        "labels": [asdict(label) for label in t.labels],
        "source": asdict(t.source),
        "report": take.report.to_dict(),
    }


def print_json(data: Any) -> None:
    """One JSON document on stdout."""
    print(json.dumps(data, indent=2))


def warn(message: str) -> None:
    """One line on stderr."""
    print(f"rigcast: {message}", file=sys.stderr)


def warner() -> Callable[[str], None]:
    """Warns of what it is told, once for as long as it is told the same."""
    last = ""

    def tell(message: str) -> None:
        nonlocal last
        if message and message != last:
            warn(message)
        last = message

    return tell
