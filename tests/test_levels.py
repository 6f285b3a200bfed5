"""Which noise levels training visits: against the schedule's own λ, and by counting."""

import numpy as np
import pytest
import torch

from motiongen.diffusion.levels import NOISIEST, balanced_times, balanced_weights
from motiongen.diffusion.schedule import COSINE


def test_half_are_even_in_time() -> None:
    assert balanced_times(torch.tensor([0.0, 0.1, 0.45])).tolist() == pytest.approx([0.0, 0.2, 0.9])


@pytest.mark.parametrize("share", [0.5, 0.6, 0.75, 0.9, 0.999])
def test_half_are_even_in_the_ratio_of_signal_to_noise(share: float) -> None:
    t = float(balanced_times(torch.tensor([share], dtype=torch.float64))[0])
    assert COSINE.log_ratio(t) == pytest.approx(NOISIEST * (2 * share - 1), abs=1e-6)


def test_the_noisiest_levels_are_visited_oftener_than_by_even_times() -> None:
    t = balanced_times(torch.linspace(0, 1, 10_001)[:-1]).numpy()
    assert t.min() >= 0
    assert t.max() < 1
    assert np.mean(t > 0.9) == pytest.approx(0.05 + 0.5 * (1 - COSINE.log_ratio(0.9) / NOISIEST), abs=1e-3)


def test_weights_are_one_on_average_and_fall() -> None:
    t = torch.linspace(0, 1, 4001)
    assert balanced_weights(t).mean().item() == pytest.approx(1, abs=1e-3)
    assert (balanced_weights(t).diff() <= 0).all()
