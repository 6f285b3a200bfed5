"""The report's page needs nothing else, holds every figure, and shows where a motion fails."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image
from two_arm_rig import TORQUE, two_arm_motion, two_arm_rig

from motiongen.motion import Label
from retarget.files import save_trajectory
from sim.checks import judge
from sim.preview import prepare
from sim.report import Change, Trials
from sim.report_page import FRAMES, write_page

EMPTY = {"meta", "img", "br", "line", "circle", "path"}


class Page(HTMLParser):
    """The tags of a page, in balance, and its text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags, self.open, self.words, self.refers = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.refers += [value for name, value in attrs if name in ("src", "href", "data", "action", "srcset")]
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in EMPTY:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def made(tmp_path, motion, **also):
    """Preview of a motion of the two-armed rig, and the page of it."""
    rig = two_arm_rig(tmp_path)
    report, rollout = judge(motion, rig)
    preview = prepare(motion, rig, replace(report, **also), rollout, "from a <test>")
    write_page(preview, tmp_path / "report.html")
    return preview, (tmp_path / "report.html").read_text("utf-8")


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    label = Label(0, 1, "stand <still> & wait")
    return made(tmp_path_factory.mktemp("still"), replace(two_arm_motion(seconds=1.0), labels=(label,)))


@pytest.fixture(scope="module")
def swinging(tmp_path_factory):
    """An arm that is thrown faster than its servo can."""
    return made(
        tmp_path_factory.mktemp("swinging"),
        two_arm_motion(seconds=1.0, left=lambda t: 1.5 * np.sin(12 * t)),
        trials=Trials(10, 4, 7, (("fall_tilt", 6),)),
        changes=(Change("pace", 1.25, "times as long", "It takes 1.25 times as long."),),
    )


def test_the_page_asks_for_nothing_and_lets_nothing_in(still):
    page = Page(still[1])
    assert all(ref.startswith("data:image/jpeg;base64,") for ref in page.refers)
    assert not {"script", "link", "iframe"} & set(page.tags)
    assert "url(" not in still[1]
    assert "@import" not in still[1]
    assert re.search(r'Content-Security-Policy" content="default-src \'none\'; img-src data:;', still[1])
    assert "<still>" not in still[1]
    assert "stand <still> & wait" in "".join(page.words)
    assert "from a <test>" in "".join(page.words)


def test_every_check_is_there_with_its_figure_and_what_it_says(still):
    preview, text = still
    words = "".join(Page(text).words)
    for check in preview.report.checks:
        assert re.search(rf"<td>{check.name}</td><td class=\"number\">{re.escape(check.found)}</td>", text)
        assert check.advice in words
    assert preview.report.report_id in words
    assert ("pass" in words) == preview.report.ok


def test_what_fails_is_pictured_where_it_fails(swinging):
    preview, text = swinging
    failed = [c for c in preview.report.failures() if c.at_s is not None]
    assert failed
    pictures = [np.asarray(Image.open(io.BytesIO(base64.b64decode(r.split(",")[1])))) for r in Page(text).refers]
    assert len(pictures) == FRAMES + len(failed)
    assert all(p.std() > 15 for p in pictures)
    for check in failed:
        assert f'<tr class="bad"><td>{check.name}</td>' in text
        assert f"<b>{check.name}</b>, {check.at_s:.2f} s" in text


def test_trials_and_what_was_mended_are_told(swinging):
    words = "".join(Page(swinging[1]).words)
    assert "4 of 10 trials passed (seed 7); failed: fall_tilt 6" in words
    assert "It takes 1.25 times as long." in words


def test_the_load_is_the_rollout_s_within_what_a_motor_has_left(swinging):
    preview, _ = swinging
    load = preview.load
    assert load.speed[1:, 0] == pytest.approx(np.diff(preview.done[:, 7]) * preview.fps)
    assert load.rated == pytest.approx([TORQUE, TORQUE])
    fastest = int(np.argmax(np.abs(load.speed[:, 0])))
    left = TORQUE * (1 - abs(load.speed[fastest, 0]) / 5.0)  # straight from stall torque to no-load speed
    forward = load.highest if load.speed[fastest, 0] > 0 else -load.lowest
    assert forward[fastest, 0] == pytest.approx(left)
    assert load.worst_first()[0] == 0


def test_the_margins_are_those_of_a_foot_under_a_still_body(still):
    footing = still[0].footing
    # Arms of 0.5 kg at 0.3 m ahead under 10 kg: the centre of mass is 27 mm ahead of the middle of a foot of 300 mm.
    assert footing.com[0] == pytest.approx([2 * 0.5 * 0.3 / 11, 0], abs=1e-6)
    assert footing.com_margin[0] == pytest.approx(0.15 - 2 * 0.5 * 0.3 / 11, abs=1e-4)
    assert footing.zmp_margin == pytest.approx(footing.com_margin, abs=1e-4)


@pytest.mark.parametrize("seconds", [0.0, 0.1])
def test_a_motion_of_a_moment_has_a_page_too(tmp_path, seconds):
    _, text = made(tmp_path, two_arm_motion(seconds=seconds))
    Page(text)


def test_another_suffix_is_refused(still, tmp_path):
    with pytest.raises(ValueError, match=r"x\.htm'?: the suffix must be \.html"):
        write_page(still[0], tmp_path / "x.htm")


def test_check_writes_the_page_of_a_motion_that_fails(tmp_path, capsys):
    from retarget.rig import load_rig
    from retarget.trajectory import Trajectory
    from rigcast.__main__ import main

    rig = load_rig("puppet")
    qpos = np.zeros((30, 7 + len(rig.joints)))
    qpos[:, 2:4] = rig.nominal.height, 1
    qpos[:, 7] = np.where(np.arange(30) % 2, 3.0, 0.0)  # beyond its range, and jumping
    save_trajectory(Trajectory(qpos, 50.0, rig.name, rig.joint_names()), tmp_path / "bad.npz")
    assert main(["check", str(tmp_path / "bad.npz"), "--out", str(tmp_path / "bad.html")]) == 1
    assert f"wrote {tmp_path / 'bad.html'}" in capsys.readouterr().out
    assert '<div class="verdict fail">fail</div>' in (tmp_path / "bad.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("name", "says"),
    [("x.bvh", "unknown suffix; known are .html, .json, .mp4, .gif, .png"), ("nowhere/x.html", "no folder")],
)
def test_a_bad_out_is_one_line_before_any_work(tmp_path, capsys, name, says):
    from rigcast.__main__ import main

    assert main(["check", str(tmp_path / "not-there.npz"), "--out", str(tmp_path / name)]) == 2
    told = capsys.readouterr().err
    assert says in told
    assert told.count("\n") == 1
