"""The report as one page that needs nothing else: verdict, pictures, every check, what was mended, plots."""

from __future__ import annotations

import base64
import io
from html import escape
from pathlib import Path

import numpy as np
from PIL import Image

from motiongen.files import replacing
from sim.plots import ALARM, Line, plot
from sim.preview import Preview
from sim.render import pictures
from sim.report import Check

FRAMES = 8  # of the filmstrip
MOST_FAULTS = 8  # that get a picture
PICTURE = (240, 240)
QUALITY = 85  # of JPEG
DONE, ASKED, SECOND = "#1f5fbf", "#9aa5b1", "#c77700"
SHOWN_JOINTS = 6  # that are open when the page is; the others are behind a click

STYLE = """
body{font:15px/1.45 system-ui,sans-serif;color:#222834;margin:0 auto;padding:24px;max-width:1080px}
h1{font-size:22px;margin:0 0 4px}h2{font-size:17px;margin:30px 0 8px}
p{margin:4px 0}.quiet{color:#5b6675;font-size:13px}
.verdict{float:right;padding:6px 18px;border-radius:6px;color:#fff;font-weight:700;font-size:20px}
.pass{background:#2e7d32}.fail{background:#c62828}
.strip{display:grid;grid-template-columns:repeat(auto-fill,minmax(118px,1fr));gap:6px}
.faults{display:grid;grid-template-columns:repeat(auto-fill,minmax(240px,1fr));gap:14px}
figure{margin:0}figure img{width:100%;border-radius:4px;display:block}
figcaption{font-size:13px;color:#5b6675;margin-top:5px}.faults img{outline:3px solid #c62828}
table{border-collapse:collapse;width:100%;font-size:14px}
td,th{text-align:left;padding:4px 10px 4px 0;border-bottom:1px solid #e3e7ec;vertical-align:top}
.number{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
.bad td{background:#fdecea}.bad td:first-child{font-weight:700;color:#c62828}.off td{color:#98a1ad}
.joints{display:grid;grid-template-columns:1fr 1fr;gap:4px 18px}.joints h3{grid-column:1/-1}
.joints h3{font-size:14px;margin:8px 0 0}
.key{font-size:13px;color:#5b6675}.key b{font-weight:600}summary{cursor:pointer;margin:10px 0}
@media(max-width:700px){.joints{grid-template-columns:1fr}}
"""
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"  # the browser itself holds it to that


def write_page(preview: Preview, path: Path) -> None:
    """Write the report on `preview` to an .html.

    Raises ValueError for another suffix, RuntimeError without OpenGL.
    """
    if Path(path).suffix.lower() != ".html":
        raise ValueError(f"cannot write a page into {str(path)!r}: the suffix must be .html")
    page = _page(preview)
    with replacing(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8")


def _page(preview: Preview) -> str:
    title = escape(preview.title or "motion")
    head = (
        f'<meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        f'<meta name="viewport" content="width=device-width"><title>{title}: {verdict(preview)}</title>'
        f"<style>{STYLE}</style>"
    )
    body = "\n".join([_summary(preview, title), _pictured(preview), report_tables(preview), _plots(preview)])
    return f'<!doctype html><html lang="en"><head>{head}</head><body>\n{body}\n</body></html>\n'


def verdict(preview: Preview) -> str:
    """`pass` or `fail`."""
    return "pass" if preview.report.ok else "fail"


def _summary(preview: Preview, title: str) -> str:
    report = preview.report
    held = f"{escape(report.rig)} on mount {report.mount}, controller {report.controller}, {report.duration_s:.1f} s"
    return (
        f'<div class="verdict {verdict(preview)}">{verdict(preview)}</div><h1>{title}</h1><p>{held}</p>'
        f'<p class="quiet">report {report.report_id}{"; " if preview.origin else ""}{escape(preview.origin)}</p>'
    )


def _pictured(preview: Preview) -> str:
    """The filmstrip, then the moments at which checks failed worst."""
    moments = np.linspace(0, len(preview) - 1, min(FRAMES, len(preview))).round().astype(int)
    failed = [c for c in preview.report.failures() if c.at_s is not None][:MOST_FAULTS]
    faults = np.array([preview.frame_at(c.at_s) for c in failed if c.at_s is not None], int)
    rows = np.concatenate([moments, faults])
    drawn = [
        _jpeg(picture)
        for picture in pictures(preview.done, preview.fps, rows, preview.rig, preview.mount, PICTURE, fine=True)
    ]
    strip = "".join(
        _figure(d, f"{row / preview.fps:.2f} s") for d, row in zip(drawn[: len(moments)], moments, strict=True)
    )
    out = f'<h2>What physics made of it</h2><div class="strip">{strip}</div>'
    if failed:
        shown = "".join(
            _figure(d, f"<b>{c.name}</b>, {c.at_s:.2f} s. {escape(c.advice)}")
            for d, c in zip(drawn[len(moments) :], failed, strict=True)
        )
        out += f'<h2>Where it fails</h2><div class="faults">{shown}</div>'
    return out


def _figure(picture: str, caption: str) -> str:
    return f'<figure><img src="{picture}" alt=""><figcaption>{caption}</figcaption></figure>'


def _jpeg(picture: np.ndarray) -> str:
    held = io.BytesIO()
    Image.fromarray(picture).save(held, format="JPEG", quality=QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(held.getvalue()).decode()}"


def report_tables(preview: Preview) -> str:
    """The checks, the trials and what was mended, as HTML tables."""
    report = preview.report
    rows = "".join(_row(check) for check in report.checks)
    head = '<th>check</th><th class="number">found</th><th class="number">limit</th><th>unit</th><th>when</th><th></th>'
    out = f"<h2>Checks</h2><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    if report.trials is not None:
        out += f"<h2>Trials</h2><p>{escape(report.trials.text)}</p>"
    if report.changes:
        changes = "".join(
            f'<tr><td>{escape(c.name)}</td><td class="number">{c.amount:.4g}</td><td>{escape(c.unit)}</td>'
            f"<td>{escape(c.text)}</td></tr>"
            for c in report.changes
        )
        head = '<th>what</th><th class="number">by</th><th>unit</th><th></th>'
        out += f"<h2>Mended</h2><table><thead><tr>{head}</tr></thead><tbody>{changes}</tbody></table>"
    return out


def _row(check: Check) -> str:
    kind = "off" if not check.applies else "" if check.ok else "bad"
    when = f"{check.at_s:.2f} s" if check.applies and check.at_s is not None else ""
    return (
        f'<tr class="{kind}"><td>{check.name}</td><td class="number">{check.found}</td>'
        f'<td class="number">{check.limit:.4g}</td><td>{escape(check.unit)}</td><td class="number">{when}</td>'
        f"<td>{escape(check.advice)}</td></tr>"
    )


def _plots(preview: Preview) -> str:
    out = ""
    if balance := balance_plot(preview, size=(1000, 150)):
        out += f'<h2>Balance</h2><p class="key">{BALANCE_KEY}</p>{balance}'
    order = preview.load.worst_first()
    joints = [_joint(preview, i) for i in order]
    out += f'<h2>Joints</h2><p class="key">{JOINT_KEY}</p><div class="joints">{"".join(joints[:SHOWN_JOINTS])}</div>'
    if len(joints) > SHOWN_JOINTS:
        rest = "".join(joints[SHOWN_JOINTS:])
        out += (
            f'<details><summary>{len(joints) - SHOWN_JOINTS} more</summary><div class="joints">{rest}</div></details>'
        )
    return out


BALANCE_KEY = (
    f'How far inside the soles\' outline, negative outside: <b style="color:{DONE}">zero-moment point</b>, '
    f'<b style="color:{SECOND}">centre of mass</b>; nothing in flight. Upright lines: where a check failed.'
)
JOINT_KEY = (
    f'The worst first. <b style="color:{DONE}">What physics made of it</b>, <b style="color:{ASKED}">what was asked '
    f'for</b>, <b style="color:{ALARM}">what the servo can</b>: torque falls with speed.'
)


def balance_plot(preview: Preview, *, now_s: float | None = None, size: tuple[int, int] = (430, 110)) -> str:
    """Margins of the zero-moment point and the centre of mass over time; empty where nothing stands."""
    footing = preview.footing
    if footing is None or not np.isfinite(footing.com_margin).any():
        return ""
    lines = [
        Line("zero-moment point", 1000 * footing.zmp_margin, DONE),
        Line("centre of mass", 1000 * footing.com_margin, SECOND),
    ]
    return plot(lines, preview.fps, "mm", marks=preview.marks(), now_s=now_s, size=size)


def torque_plot(preview: Preview, joint: int, *, now_s: float | None = None) -> str:
    """Torque of the joint's servo between what it has left at its speed."""
    load = preview.load
    lines = [
        Line("most", load.highest[:, joint], ALARM, dashed=True),
        Line("least", load.lowest[:, joint], ALARM, dashed=True),
        Line("torque", load.torque[:, joint], DONE),
    ]
    return plot(lines, preview.fps, "N·m", now_s=now_s)


def speed_plot(preview: Preview, joint: int, *, now_s: float | None = None) -> str:
    """Speed of the joint, asked for and done, between those that it is allowed."""
    load, flat = preview.load, np.ones(len(preview))
    lines = [
        Line("most", load.allowed[joint] * flat, ALARM, dashed=True),
        Line("least", -load.allowed[joint] * flat, ALARM, dashed=True),
        Line("asked for", load.asked_speed[:, joint], ASKED),
        Line("speed", load.speed[:, joint], DONE),
    ]
    return plot(lines, preview.fps, "rad/s", now_s=now_s)


def _joint(preview: Preview, joint: int) -> str:
    load = preview.load
    torque, speed = np.abs(load.torque[:, joint]).max(), np.abs(load.speed[:, joint]).max()
    told = (
        f"{escape(preview.rig.joints[joint].name)}: up to {torque:.2f} of {load.rated[joint]:.2f} N·m, "
        f"{speed:.2f} of {load.allowed[joint]:.2f} rad/s"
    )
    return f"<h3>{told}</h3>{torque_plot(preview, joint)}{speed_plot(preview, joint)}"
