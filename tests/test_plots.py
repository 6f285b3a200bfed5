"""Plots are SVG that parses, with every line where its values are and no peak lost."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from sim.plots import LEFT, MOST_POINTS, RIGHT, Line, Mark, plot, thinned, ticks

SVG = "{http://www.w3.org/2000/svg}"


def drawn(svg: str) -> list[list[tuple[str, float, float]]]:
    """Of every path its moves and lines: letter, x, y in pixels."""
    paths = ElementTree.fromstring(svg).findall(f"{SVG}path")
    step = re.compile(r"([ML])([\d.-]+) ([\d.-]+)")
    return [[(k, float(x), float(y)) for k, x, y in step.findall(p.attrib["d"])] for p in paths]


def test_a_line_runs_over_the_whole_width_and_larger_is_higher():
    (line,) = drawn(plot([Line("ramp", np.linspace(0, 4, 51), "#000")], 50, "m", size=(400, 100)))
    assert [line[0][1], line[-1][1]] == [LEFT, 400 - RIGHT]
    assert line[0][0] == "M"
    assert {k for k, _, _ in line[1:]} == {"L"}
    x, y = np.array([step[1:] for step in line]).T
    assert np.allclose(np.diff(x), np.diff(x)[0], atol=0.11)  # rounded to tenths of a pixel
    assert (np.diff(y) < 0).all()


def test_two_lines_share_one_scale_with_zero_in_it():
    low, high = drawn(plot([Line("2", np.full(9, 2.0), "#000"), Line("4", np.full(9, 4.0), "#000")], 8, "m"))
    zero = float(
        re.search(r'y1="([\d.]+)"[^>]*stroke="#5b6675"', plot([Line("2", np.array([2.0, 4.0]), "#0")], 1, "m"))[1]
    )
    assert zero - high[0][2] == pytest.approx(2 * (zero - low[0][2]), abs=0.2)


def test_a_gap_breaks_the_line():
    (line,) = drawn(plot([Line("flight", np.array([1.0, 2.0, np.nan, 1.0, 2.0]), "#000")], 1, "m"))
    assert [k for k, _, _ in line] == ["M", "L", "M", "L"]


def test_a_mark_stands_at_its_time_and_its_words_are_no_markup():
    svg = ElementTree.fromstring(plot([Line("a", np.zeros(11), "#000")], 1, "m", marks=[Mark(5.0, "<b>fall")]))
    (mark,) = [e for e in svg.findall(f"{SVG}line") if e.find(f"{SVG}title") is not None]
    assert float(mark.attrib["x1"]) == pytest.approx((LEFT + 430 - RIGHT) / 2, abs=0.06)
    assert mark.find(f"{SVG}title").text == "<b>fall, 5.00 s"


def test_thinning_keeps_every_peak_of_half_an_hour():
    values = np.sin(np.arange(90_000) / 700)
    values[[31_337, 77_777]] = 9, -9
    kept = thinned(values)
    assert len(kept) <= MOST_POINTS
    assert kept == sorted(set(kept))
    assert {31_337, 77_777} <= set(kept)
    assert thinned(np.full(5_000, np.nan))  # a motion all in flight


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0, 10, [0, 2, 4, 6, 8, 10]),
        (-4.3, 4.3, [-4, -2, 0, 2, 4]),
        (0, 0.003, [0, 0.001, 0.002, 0.003]),
        (0, 1800, [0, 500, 1000, 1500]),
    ],
)
def test_ticks_are_round_and_few(low, high, expected):
    assert ticks(low, high) == expected


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([], "lines of one length"),
        ([Line("a", np.zeros(3), ""), Line("b", np.zeros(4), "")], r"\[3, 4\]"),
        ([Line("a", np.full(3, np.nan), "")], "of a: not one value is finite"),
    ],
)
def test_what_cannot_be_plotted_is_told(lines, says):
    with pytest.raises(ValueError, match=says):
        plot(lines, 50, "m")
