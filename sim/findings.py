"""The report as the HTML that fits beside a picture: verdict, what failed and what to do, what was mended."""

from __future__ import annotations

from html import escape

from sim.preview import Preview
from sim.report import Report

PASS, FAIL, QUIET = "#2e7d32", "#c62828", "#5b6675"
SMALL = f"font-size:0.85em;color:{QUIET}"


def findings(preview: Preview) -> str:
    """What there is to know about the motion that is shown."""
    report = preview.report
    word, colour = ("pass", PASS) if report.ok else ("fail", FAIL)
    badge = f'<b style="background:{colour};color:#fff;border-radius:4px;padding:1px 9px">{word}</b>'
    held = f"{escape(report.rig)} on mount {report.mount}, {report.controller}, {report.duration_s:.1f} s"
    parts = [
        f"<p>{badge} <b>{escape(preview.title or 'motion')}</b></p>",
        f'<p style="{SMALL}">{held}; report {report.report_id}</p>',
        faults(report),
    ]
    if report.trials is not None:
        parts.append(f"<p>{escape(report.trials.text)}</p>")
    if report.changes:
        parts.append(f"<p><b>Mended</b></p>{_items([escape(change.text) for change in report.changes])}")
    parts.append(f"<details><summary>all {len(report.checks)} checks</summary>{_table(report)}</details>")
    if preview.origin:
        parts.append(f'<p style="{SMALL}">{escape(preview.origin)}</p>')
    return boxed("".join(parts))


def faults(report: Report) -> str:
    """Each check that failed: its figure, its limit, when, and what to do; empty where none did."""
    return _items(
        [
            f'<b style="color:{FAIL}">{check.name}</b> {check.found} {escape(check.unit)}, at most {check.limit:.4g}'
            f"{'' if check.at_s is None else f', worst at {check.at_s:.2f} s'}. {escape(check.advice)}"
            for check in report.failures()
        ]
    )


def _table(report: Report) -> str:
    rows = "".join(
        f'<tr style="color:{"inherit" if check.applies else QUIET}"><td>{check.name}</td>'
        f'<td align="right">{check.found}</td><td align="right">{check.limit:.4g}</td>'
        f"<td>{escape(check.unit)}</td></tr>"
        for check in report.checks
    )
    head = '<tr><th align="left">check</th><th align="right">found</th><th align="right">at most</th><th></th></tr>'
    return f'<table style="width:100%;font-size:0.85em">{head}{rows}</table>'


def boxed(html: str) -> str:
    """`html` as wide and as dense as the page's own controls."""
    return f'<div class="findings" style="font-size:14px;line-height:1.35;padding:0 0.5em">{html}</div>'


def _items(lines: list[str]) -> str:
    items = "".join(f"<li>{line}</li>" for line in lines)
    return f'<ul style="margin:4px 0;padding-left:1.2em">{items}</ul>' if lines else ""
