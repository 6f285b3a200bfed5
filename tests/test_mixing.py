"""Several estimates of the noise made one, against the sums and the gradient that the paper's Eq. 10 and 11 state."""

import numpy as np
import pytest
from noise_mixing import slopes

from motiongen.diffusion.mixing import Span, mix, mix_parts, mix_times, shares

B, T, F = 2, 7, 6
LEGS, ARM, HEAD = (np.array([c in s for c in "llaahh"]) for s in "lah")


def noises(count: int, frames: int = T) -> list[np.ndarray]:
    rng = np.random.default_rng(count)
    return [rng.standard_normal((B, frames, F)) for _ in range(count)]


def test_without_correction_parts_are_cut_and_pasted() -> None:
    eps, masks = noises(3), np.stack([LEGS, ARM, HEAD])
    assert np.array_equal(mix_parts(eps, masks, 0.0), eps[0] * LEGS + eps[1] * ARM + eps[2] * HEAD)


def test_one_part_that_is_the_body_is_the_models_own() -> None:
    (eps,) = noises(1)
    assert np.array_equal(mix_parts([eps], np.ones((1, F), bool), 0.5), eps)
    assert np.array_equal(mix_times([eps], [(0, T)], 0.5), eps)


def test_the_correction_of_parts_is_the_gradient_of_the_norms() -> None:
    eps, masks = noises(3), np.stack([LEGS, ARM, HEAD])
    pairs = [(i, j, slice(None)) for i in range(3) for j in range(3) if i != j]
    expected = sum((e + 0.3 * g) * m for e, g, m in zip(eps, slopes(eps, pairs), masks, strict=True))
    assert np.abs(mix_parts(eps, masks, 0.3) - expected).max() < 1e-12


def test_equal_estimates_need_no_correction() -> None:
    (eps,) = noises(1)
    assert np.array_equal(mix_parts([eps, eps], np.stack([LEGS, ~LEGS]), 0.3), eps)


def test_an_overlap_counts_once_and_goes_over_in_a_line() -> None:
    a, b = np.ones((1, 20, F)), np.full((1, 24, F), 3.0)
    mixed = mix_times([a, b], [(0, 20), (16, 40)], 0.0)[0, :, 0]
    assert np.allclose(mixed[:16], 1)
    assert np.allclose(mixed[16:20], [1.25, 1.75, 2.25, 2.75])
    assert np.allclose(mixed[20:], 3)


def test_an_interval_within_another_fades_in_and_out() -> None:
    share = shares([Span(0, 30, np.ones(F, bool)), Span(10, 20, np.ones(F, bool))], fade=30)
    inner = np.concatenate([[0], share[1][:, 0], [0]])
    assert np.abs(np.diff(inner)).max() < 0.06
    assert np.allclose(share[0][10:20] + share[1], 1)


def test_the_correction_of_times_is_the_gradient_of_the_norms_in_the_overlap() -> None:
    eps = [noises(4, frames)[k] for k, frames in enumerate((5, 6, 4))]
    spans = [Span(0, 5, np.ones(F, bool)), Span(3, 9, np.ones(F, bool)), Span(7, 11, np.ones(F, bool))]
    weight = [np.pad(w, ((s.start, 11 - s.stop), (0, 0))) for w, s in zip(shares(spans, 11), spans, strict=True)]
    full = [np.pad(e, ((0, 0), (s.start, 11 - s.stop), (0, 0))) for e, s in zip(eps, spans, strict=True)]
    meet = [(0, 1, slice(3, 5)), (1, 0, slice(3, 5)), (1, 2, slice(7, 9)), (2, 1, slice(7, 9))]
    expected = sum(w * (e + 0.2 * g) for w, e, g in zip(weight, full, slopes(full, meet), strict=True))
    assert np.abs(mix_times(eps, [(s.start, s.stop) for s in spans], 0.2) - expected).max() < 1e-6


def timeline() -> list[Span]:
    """Told nothing; legs from the start; the whole body from frame 10; an arm in between."""
    everything = np.ones(F, bool)
    return [Span(0, 30, everything, told=False), Span(0, 15, LEGS), Span(10, 30, everything), Span(18, 27, ARM)]


def test_shares_add_up_to_one() -> None:
    spans = timeline()
    total = np.zeros((30, F))
    for span, share in zip(spans, shares(spans, 4), strict=True):
        total[span.start : span.stop] += share
    assert np.allclose(total, 1)


def test_the_narrower_is_heard_then_the_body_then_the_model_untold() -> None:
    untold, legs, body, arm = shares(timeline(), 4)
    assert (legs[:11, :2] == 1).all()
    assert (legs[:, 2:] == 0).all()
    assert (untold[:10, 2:] == 1).all()  # nothing is said of arm and head
    assert (untold[14:] == 0).all()
    assert (arm[4, 2:4] == 1).all()
    assert (body[12, 2:4] == 0).all()  # frame 22, the middle of the arm's span
    assert (body[12, [0, 1, 4, 5]] == 1).all()
    assert np.allclose(arm[:4, 2], [0.125, 0.375, 0.625, 0.875])
    assert np.allclose(body[8:12, 2], [0.875, 0.625, 0.375, 0.125])


def test_what_the_wider_share_among_themselves_is_no_matter_of_the_narrower() -> None:
    everything, arm = np.ones(F, bool), Span(8, 20, ARM)
    one = shares([Span(0, 30, everything), arm], 4)[1]
    two = shares([Span(0, 20, everything), Span(8, 30, everything), arm], 4)[2]
    assert np.allclose(one, two)


def test_parts_and_times_have_each_their_own_correction() -> None:
    spans = [Span(0, 10, LEGS), Span(0, 6, ~LEGS), Span(4, 10, ~LEGS)]
    eps = [noises(3, s.stop - s.start)[k] for k, s in enumerate(spans)]
    share = shares(spans, 10)
    plain = mix(eps, spans, share)
    parts, times = mix(eps, spans, share, lam_parts=0.1) - plain, mix(eps, spans, share, lam_times=0.1) - plain
    assert (parts[:, :, LEGS] != 0).all()
    assert (times[..., LEGS] == 0).all()
    assert (times[:, :4] == 0).all()
    assert (times[:, 4:6, ~LEGS] != 0).all()
    assert np.allclose(mix(eps, spans, share, 0.1, 0.1), plain + parts + times)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (lambda: shares([Span(0, 4, LEGS | ARM | HEAD), Span(6, 9, LEGS | ARM | HEAD)], 1), "frame 4 and 1 more"),
        (lambda: shares([Span(0, 4, LEGS)], 1), "frame 0 and 3 more"),
        (lambda: shares([Span(0, 4, LEGS)], 0), "not 0"),
        (lambda: Span(4, 4, LEGS), "from 4 to 4"),
        (lambda: Span(-1, 4, LEGS), "from -1 to 4"),
        (lambda: Span(0, 4, LEGS & ARM), "one feature"),
        (lambda: mix_parts(noises(2), np.stack([LEGS, ARM]), 0.0), "feature 4 belongs to 0 parts"),
        (lambda: mix_times(noises(2), [(0, T), (T + 1, 2 * T + 1)], 0.0), "frame 7 and 0 more"),
    ],
)
def test_gaps_and_empty_spans_are_refused(wrong: object, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        wrong()
