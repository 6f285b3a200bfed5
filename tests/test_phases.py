"""Phases: waves against numpy's FFT, primary segments against Eq. 1 tried one by one, repetition, joining, blending."""

from itertools import combinations

import numpy as np
import pytest

from motiongen.phase.phases import Layout, Timing, amplitude_shift_offset, course, readings, signals
from motiongen.phase.phrases import (
    Phrase,
    blended,
    joined_frames,
    joined_signals,
    lasting,
    looped_signals,
    phrase_of,
    phrase_signals,
)
from motiongen.phase.segments import ALIKE, AWAY, LONG, LONGEST_END, SHORTEST, primary_segments, timing_of

LAYOUT = Layout(highest=6, phases=12)
RNG = np.random.default_rng(0)


def timing(head: int, period: int, tail: int) -> Timing:
    return Timing(*(np.array([n]) for n in (head, period, tail)))


def random_code() -> np.ndarray:
    return RNG.normal(size=(1, LAYOUT.width)).astype(np.float32)


def phrase(head: int, period: int, tail: int) -> Phrase:
    return Phrase(random_code()[0], head, period, tail, period)


def test_a_layout_has_every_divisor_as_often() -> None:
    assert Layout().frequencies == (1, 2, 3, 5, 6, 10, 15, 30)
    assert Layout(8).frequencies == (1, 2, 4, 8)
    assert [LAYOUT.tokens[0], LAYOUT.tokens[-1]] == [slice(0, 9), slice(LAYOUT.width - 2, LAYOUT.width)]
    with pytest.raises(ValueError, match=r"100 phases; they must be a multiple of 8, the number of divisors of .* 30"):
        Layout(30, 100)


def test_signals_have_the_spectrum_that_the_code_says() -> None:
    """By numpy's FFT of one period: A, S and B of every phase, sine and cosine."""
    code, period = random_code(), 64
    made = signals(code, course(timing(0, period, 0), np.arange(period)), LAYOUT)[0]
    spectrum = np.fft.rfft(made, axis=0) / period
    amplitude, shift, offset = (y[0].ravel() for y in amplitude_shift_offset(code, LAYOUT))
    frequency = np.repeat(LAYOUT.frequencies, LAYOUT.group)
    phase = np.arange(LAYOUT.phases)
    wave = amplitude / 2 * np.exp(-2j * np.pi * shift)
    assert np.allclose(spectrum[frequency, phase], -1j * wave, atol=1e-6)
    assert np.allclose(spectrum[frequency, LAYOUT.phases + phase], wave, atol=1e-6)
    assert np.allclose(spectrum[0].real, np.tile(offset, 2), atol=1e-6)
    spectrum[0] = spectrum[frequency, phase] = spectrum[frequency, LAYOUT.phases + phase] = 0
    assert np.abs(spectrum).max() < 1e-6


def test_readings_are_the_fft_of_the_primary_segment() -> None:
    x, when = RNG.normal(size=(80, 3)), timing(10, 50, 19)
    read = (readings(when, 90, 6) @ np.pad(x, ((0, 10), (0, 0))))[0]
    spectrum = 2 * np.fft.rfft(x[10:60], axis=0) / 50
    assert np.allclose(read[0], x[10:60].mean(0), atol=1e-6)
    assert np.allclose(read[1:7] + 1j * read[7:13], -1j * np.conj(spectrum[1:7]), atol=1e-6)
    ends = [x[:10].mean(0) - x[10], x[0] - x[10], x[61:].mean(0) - x[60], x[79] - x[60]]
    assert np.allclose(read[13:], ends, atol=1e-6)
    assert np.allclose(readings(timing(0, 79, 0), 80, 6)[0, 13:] @ x, 0.0, atol=1e-6)


def test_head_and_tail_are_straight_and_meet_the_waves() -> None:
    code, when = random_code(), timing(8, 40, 5)
    made = signals(code, course(when, np.arange(54)), LAYOUT)[0]
    assert np.allclose(np.diff(made[:9], 2, axis=0), 0.0, atol=1e-5)
    assert np.allclose(np.diff(made[48:], 2, axis=0), 0.0, atol=1e-5)
    assert np.allclose(made[8], made[48], atol=1e-5)
    *_, head, tail, _ = LAYOUT.tokens
    assert np.allclose(made[0] - made[8], code[0, head], atol=1e-5)
    assert np.allclose(made[53] - made[48], code[0, tail], atol=1e-5)
    beyond = signals(code, course(when, np.array([-3, 60])), LAYOUT)[0]
    assert np.array_equal(beyond, made[[0, 53]])


def test_segments_are_those_of_least_cost() -> None:
    x = np.cumsum(RNG.normal(size=(46, 4)), axis=0).astype(np.float32)
    apart = ((x[:, None] - x) ** 2).sum(-1)
    apart /= apart[::3, ::3].mean()

    def cost(s: int, e: int) -> float:
        return float(ALIKE * apart[s, e] - LONG * (e - s) / 45 - AWAY * (apart[0, s] + apart[45, e]))

    every = [(s, e) for s, e in combinations(range(0, 46, 3), 2) if e - s >= SHORTEST]
    best, *others = primary_segments(x)
    assert tuple(best) == min(every, key=lambda pair: cost(*pair))
    assert all(cost(*best) <= cost(*other) for other in others)


def test_the_part_that_repeats_is_found_between_rest() -> None:
    wave = np.sin(2 * np.pi * np.arange(60) / 20)
    arm = np.concatenate([np.zeros(15), np.linspace(0, 1, 15), 1 + 0.3 * wave, np.linspace(1, 0, 15), np.zeros(15)])
    start, stop = primary_segments(np.stack([arm, np.zeros_like(arm)], 1).astype(np.float32))[0]
    assert 24 <= start < start + 30 < stop <= 96
    assert abs((stop - start) % 20) <= 2 or (stop - start) % 20 >= 18


def test_a_motion_too_short_is_one_segment_and_one_frame_is_refused() -> None:
    assert primary_segments(np.zeros((SHORTEST, 2), np.float32)).tolist() == [[0, SHORTEST - 1]]
    with pytest.raises(ValueError, match="a motion of 1 frames has no segment; it needs two or more"):
        primary_segments(np.zeros((1, 2), np.float32))
    when = timing_of(np.array([[3, 30]]), np.array([41]))
    assert (when.head, when.period, when.tail, when.frames) == (3, 27, 10, 41)


@pytest.mark.parametrize("times", [1, 2, 5])
def test_repetition_is_exactly_periodic(times: int) -> None:
    short = phrase(7, 33, 9)
    long = lasting(short, short.frames + (times - 1) * 33)
    assert (long.head, long.period, long.tail, long.loop) == (7, 33, 9, 33 * times)
    made = phrase_signals(long, LAYOUT, np.arange(long.frames))
    once = phrase_signals(short, LAYOUT, np.arange(short.frames))
    for turn in range(times):
        assert np.array_equal(made[7 + 33 * turn :][:34], once[7:41])
    assert np.array_equal(made[-9:], once[-9:])
    assert np.array_equal(made[:7], once[:7])


@pytest.mark.parametrize("head", [0, 12])
@pytest.mark.parametrize("tail", [0, 1, 12])
@pytest.mark.parametrize("frames", [60, 77, 119, 300])
def test_a_phrase_lasts_as_long_as_it_should(head: int, tail: int, frames: int) -> None:
    long = lasting(phrase(head, 31, tail), frames)
    assert long.frames == frames
    assert long.head == head
    assert tail == 0 or long.loop % long.period == 0
    assert 0.6 < long.period / 31 < 1.6


def test_timing_is_shared_out_as_the_code_says() -> None:
    code = np.zeros(LAYOUT.width, np.float32)
    code[-2:] = 0.2, 0.1
    made = phrase_of(code, 101, LAYOUT)
    assert (made.head, made.period, made.tail, made.loop) == (20, 70, 10, 70)
    code[-2:] = 0.9, 0.9
    made = phrase_of(code, 101, LAYOUT)
    assert made.frames == 101
    assert made.period >= SHORTEST
    code[-2:] = -0.3, 0.01
    assert phrase_of(code, 101, LAYOUT).period == 100


def test_blending_gives_either_at_0_and_1() -> None:
    a, b = RNG.normal(size=(2, 5, 3)).astype(np.float32)
    assert np.array_equal(blended(a, b, 0), a)
    assert np.array_equal(blended(a, b, 1), b)
    weight = np.array([0, 0.25, 0.5, 1, 0])
    assert np.allclose(blended(a, b, weight), a + weight[:, None] * (b - a), atol=1e-6)
    assert np.array_equal(blended(a, b, weight)[[0, 3, 4]], [a[0], b[3], a[4]])


def test_joined_phrases_are_themselves_away_from_the_join() -> None:
    first, middle, last = phrase(6, 40, 8), phrase(5, 36, 7), phrase(9, 50, 4)
    count = joined_frames([first, middle, last])
    made = joined_signals([first, middle, last], LAYOUT, np.arange(count))
    assert count == 6 + 40 + 36 + 50 + 4 + 1
    assert np.array_equal(made[:40], phrase_signals(first, LAYOUT, np.arange(40)))
    assert np.array_equal(made[53:75], looped_signals(middle, LAYOUT, np.arange(7, 29)))
    end = phrase_signals(last, LAYOUT, np.arange(last.frames))
    assert np.allclose(made[-40:], end[-40:], atol=1e-6)
    either = [looped_signals(p, LAYOUT, np.array([at]))[0] for p, at in ((first, 40), (middle, 0))]
    assert np.allclose(made[46], np.mean(either, axis=0), atol=1e-6)


def test_signals_between_frames_are_on_the_same_waves() -> None:
    one = phrase(4, 30, 4)
    dense = phrase_signals(one, LAYOUT, np.arange(0, 38.5, 0.5))
    assert np.array_equal(dense[::2], phrase_signals(one, LAYOUT, np.arange(39)))
    assert np.allclose(dense[9:67:2], looped_signals(one, LAYOUT, np.arange(0.5, 29.5)), atol=1e-5)


def test_heads_and_tails_are_short() -> None:
    x = np.cumsum(RNG.normal(size=(200, 4)), axis=0).astype(np.float32)
    found = primary_segments(x)
    assert len(found) > 1
    assert (found[:, 0] <= LONGEST_END).all()
    assert (found[:, 1] >= 199 - LONGEST_END).all()
