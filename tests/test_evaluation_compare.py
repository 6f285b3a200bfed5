"""Comparing two evaluations: tests of significance against scipy and worked numbers, pairs that are none."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy.stats import binomtest, ttest_rel

from motiongen.evaluation.compare import Comparison, bootstrap, compare, compare_files, holm, mcnemar
from motiongen.evaluation.run.results import (
    VERSION,
    Items,
    Results,
    ResultsError,
    Subject,
    digest_of,
    read_results,
    write_results,
)

TEXTS = tuple(f"text {i}" for i in range(60))


def results(right: list[int], amounts: list[float | None], name: str = "a", seed: int = 0) -> Results:
    digest = digest_of(TEXTS)
    items = (
        Items("language", "counts", digest, tuple(map(float, right)), True, "more"),
        Items("motion", "floating", digest, tuple(amounts), False, "less"),
    )
    subject = Subject(name, "", "", 1, 0, (), items)
    return Results(
        VERSION, "2026-01-01", "a machine", "data", "d", {"clips": 60}, seed, {"guo": "g"}, {digest: TEXTS}, (subject,)
    )


def both(one: Results, other: Results) -> Comparison:
    return compare(one, one.subjects[0], other, other.subjects[0])


@pytest.mark.parametrize(("only_a", "only_b", "alike"), [(9, 2, 40), (3, 3, 5), (0, 0, 10), (0, 7, 1), (31, 60, 300)])
def test_mcnemar_is_the_exact_binomial_test(only_a: int, only_b: int, alike: int) -> None:
    a = np.repeat([1, 0, 1], [only_a, only_b, alike])
    b = np.repeat([0, 1, 1], [only_a, only_b, alike])
    expected = binomtest(only_a, only_a + only_b).pvalue if only_a + only_b else 1.0
    assert mcnemar(a, b) == pytest.approx(expected)


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.25])
def test_bootstrap_agrees_with_the_t_test_where_that_holds(shift: float) -> None:
    rng = np.random.default_rng(3)
    a = rng.normal(size=400)
    b = a + rng.normal(shift, 1.0, size=400)
    low, high, p = bootstrap(a, b)
    wanted = ttest_rel(b, a)
    assert p == pytest.approx(wanted.pvalue, abs=0.012)
    assert (low, high) == pytest.approx(tuple(wanted.confidence_interval(0.95)), abs=0.01)


def test_no_difference_at_all_is_no_evidence() -> None:
    low, high, p = bootstrap([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    assert (low, high, p) == (0.0, 0.0, 1.0)


def test_holm_stops_at_the_first_that_falls() -> None:
    # Worked by hand: 0.01 ≤ 0.05/4, 0.016 ≤ 0.05/3, 0.03 > 0.05/2, and 0.04 falls with it though 0.04 ≤ 0.05.
    assert holm([0.03, 0.01, 0.04, 0.016]) == [False, True, False, True]


def test_pairs_without_a_value_on_either_side_are_left_out() -> None:
    found = both(results([1] * 60, [None] + [0.0] * 59), results([1] * 60, [9.0, None] + [0.5] * 58))
    floating = next(row for row in found.rows if row.name == "floating")
    assert (floating.n, floating.difference) == (58, 0.5)


def test_verdicts_say_which_way_is_better() -> None:
    rng = np.random.default_rng(0)
    heights = rng.uniform(0, 0.01, 60)
    found = both(results([0] * 60, list(heights)), results([1] * 50 + [0] * 10, list(heights + 0.02), "b"))
    assert {row.name: row.verdict for row in found.rows} == {"counts": "better", "floating": "worse"}
    assert found.sentence.startswith("Beyond chance, b against a is better in 1 of 2 measures: counts (language)")


def test_what_chance_would_do_has_no_verdict() -> None:
    found = both(results([1, 0] * 30, [0.0] * 60), results([1, 0] * 29 + [1, 1], [0.0] * 60, "b"))
    assert [row.verdict for row in found.rows] == ["", ""]
    assert "does not differ" in found.sentence


def test_runs_that_differ_in_what_was_asked_are_refused() -> None:
    one = results([1] * 60, [0.0] * 60)
    for other, word in (
        (results([1] * 60, [0.0] * 60, seed=1), "seed"),
        (msgspec.structs.replace(one, judges={"guo": "another"}), "judges"),
        (msgspec.structs.replace(one, data_digest="another"), "data set"),
        (msgspec.structs.replace(one, plan={"clips": 3}), "plan"),
    ):
        with pytest.raises(ResultsError, match=word):
            both(one, other)


def test_subjects_without_a_prompt_in_common_are_refused() -> None:
    one = results([1] * 60, [0.0] * 60)
    items = tuple(msgspec.structs.replace(each, texts="others") for each in one.subjects[0].items)
    other = msgspec.structs.replace(one, subjects=(msgspec.structs.replace(one.subjects[0], items=items),))
    with pytest.raises(ResultsError, match="nothing in common"):
        both(one, other)


def test_files_are_named_by_path_folder_and_subject(tmp_path: Path) -> None:
    one, other = results([1] * 60, [0.0] * 60, "mdm"), results([0] * 60, [0.0] * 60, "gestures")
    together = msgspec.structs.replace(one, subjects=one.subjects + other.subjects)
    write_results(together, tmp_path / "results.json")
    assert read_results(tmp_path / "results.json") == together
    found = compare_files(f"{tmp_path}#mdm", f"{tmp_path / 'results.json'}#gestures")
    assert (found.a, found.b) == ("mdm", "gestures")
    for where, said in (
        (str(tmp_path), "holds mdm, gestures; say which"),
        (f"{tmp_path}#dances", "no subject 'dances'; it holds mdm, gestures"),
        (str(tmp_path / "nothing.json"), "no such file"),
    ):
        with pytest.raises(ResultsError, match=said):
            compare_files(where, f"{tmp_path}#mdm")


@pytest.mark.parametrize("text", ["", "{", "[]", '{"version": 1}', "\udcff"])
def test_a_file_that_is_no_results_is_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "results.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(ResultsError, match=r"not the results.json"):
        read_results(path)


def test_results_of_another_version_are_refused(tmp_path: Path) -> None:
    write_results(msgspec.structs.replace(results([1] * 60, [0.0] * 60), version=99), tmp_path / "results.json")
    with pytest.raises(ResultsError, match="version 99"):
        read_results(tmp_path / "results.json")
