"""The frame of the benchmark of the generators, and the moments of samplers that it works out without drawing."""

import json
import sys

import generators
import numpy as np
import pytest
from exact_denoisers import Mixture, exact_x0
from lines import Line
from parts import Options, Part
from sampler_errors import DEVIATIONS, error, transfer

from motiongen.diffusion.samplers import SAMPLERS
from motiongen.diffusion.schedule import LINEAR, even_times


@pytest.mark.parametrize("name", SAMPLERS)
def test_moments_without_drawing_are_those_of_samples(name: str) -> None:
    normal = Mixture(np.ones(1), np.array([[1.0, -2.0]]), np.array([[[1.0, 0.3], [0.3, 0.5]]]))
    denoise, times = exact_x0(normal, LINEAR), even_times(4)
    mean, spread = transfer(SAMPLERS[name], denoise, LINEAR, times, 2)
    random = np.random.default_rng(0)
    x = SAMPLERS[name](denoise, lambda: random.standard_normal((100_000, 2)), LINEAR, times)
    assert np.allclose(x.mean(0), mean, atol=0.01)
    assert np.allclose(np.cov(x.T), spread, atol=0.01)


def test_no_error_where_there_is_none() -> None:
    assert error(np.ones(6), np.diag(np.square(DEVIATIONS))) == pytest.approx(0, abs=1e-15)
    assert error(np.ones(6), np.diag(np.square(DEVIATIONS)) * 1.21) == pytest.approx(0.1)


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    def two(options: Options) -> Part:
        found = 1.0 if options.quick else 3.0
        return Part((("a", "b"), ("long", "1")), (Line("two", "small", found, 2.0, False),))

    monkeypatch.setattr(generators, "PARTS", {"two": two})
    monkeypatch.setattr(sys, "argv", ["generators.py", *arguments])
    return generators.main()


def test_gate_names_what_falls_short(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, "--gate") == 1
    printed = capsys.readouterr().out.splitlines()
    assert printed[2:4] == ["a     b", "long  1"]
    assert printed[-1] == "short: small"
    assert run(monkeypatch, "--gate", "--quick", "--part", "two") == 0
    assert run(monkeypatch) == 0


def test_json_is_one_document(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, "--json") == 0
    two = json.loads(capsys.readouterr().out)["two"]
    assert two["rows"] == [["a", "b"], ["long", "1"]]
    assert [line["holds"] for line in two["lines"]] == [False]
