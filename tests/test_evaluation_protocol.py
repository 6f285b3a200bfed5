"""The whole protocol against a plain second reading of it, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from motions import motion, walk

from motiongen.evaluation.protocol import Clips, Embedded, Score, embed, evaluate, score, score_actions, table
from motiongen.motion import Motion, Skeleton

CLIPS = 352  # eleven whole batches


def embedded(seed: int, clips: int = CLIPS, width: int = 12) -> Embedded:
    rng = np.random.default_rng(seed)
    text = rng.normal(size=(clips, width))
    return Embedded(text, text + rng.normal(size=text.shape), tuple(f"caption {i}" for i in range(clips)))


def second_reading(real: Embedded, draws: list[Embedded], repeated: np.ndarray, seed: int) -> dict[str, list[float]]:
    """The protocol as its authors describe it, with loops, and scipy's matrix root."""
    out: dict[str, list[float]] = {}
    for number, draw in enumerate(draws):
        rng = np.random.default_rng([seed, number])
        order = rng.permutation(len(draw.text))
        top, near = np.zeros(3), 0.0
        for start in range(0, len(order) - 31, 32):
            rows = order[start : start + 32]
            for i in rows:
                d = [np.linalg.norm(draw.text[i] - draw.motion[j]) for j in rows]
                own = np.linalg.norm(draw.text[i] - draw.motion[i])
                place = sum(x < own for x in d)
                top += place < np.arange(1, 4)
                near += own
        count = len(order) // 32 * 32
        a, b = real.motion, draw.motion
        ca, cb = np.cov(a.T), np.cov(b.T)
        root = scipy.linalg.sqrtm(ca @ cb).real
        one, two = rng.choice(len(b), 300, replace=False), rng.choice(len(b), 300, replace=False)
        first, second = rng.choice(30, 10, replace=False), rng.choice(30, 10, replace=False)
        apart = [np.linalg.norm(t[i] - t[j]) for t in repeated for i, j in zip(first, second, strict=True)]
        found = {
            **{f"top {k}": top[k] / count for k in range(3)},
            "mm_dist": near / count,
            "fid": ((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(ca) + np.trace(cb) - 2 * np.trace(root),
            "diversity": np.mean([np.linalg.norm(b[i] - b[j]) for i, j in zip(one, two, strict=True)]),
            "multimodality": np.mean(apart),
        }
        for name, value in found.items():
            out.setdefault(name, []).append(float(value))
    return out


def test_equal_to_a_plain_second_reading() -> None:
    real, draws = embedded(0), [embedded(s) for s in range(1, 21)]
    repeated = np.random.default_rng(9).normal(size=(100, 30, 12))
    ours = score("judge", real, draws, repeated=repeated, seed=4)
    assert (ours.clips, ours.ranked, ours.replications, ours.draws, ours.diversity_pairs) == (CLIPS, CLIPS, 20, 20, 300)
    assert ours.multimodality is not None
    by_name = {f"top {k}": s for k, s in enumerate(ours.r_precision)}
    by_name |= {n: getattr(ours, n) for n in ("mm_dist", "fid", "diversity", "multimodality")}
    for name, values in second_reading(real, draws, repeated, seed=4).items():
        mean, half = np.mean(values), 1.96 * np.sqrt(np.var(values) / 20)
        assert (by_name[name].mean, by_name[name].interval) == pytest.approx((mean, half), rel=1e-6), name


def test_one_set_of_motions_serves_every_replication() -> None:
    real, made = embedded(0), embedded(1)
    scores = score("judge", real, [made])
    assert scores.draws == 1
    assert scores.fid.interval == 0  # nothing about FID is drawn again
    assert scores.r_precision[0].interval > 0


def test_the_same_seed_gives_the_same_scores() -> None:
    real, made = embedded(0), embedded(1)
    assert score("judge", real, [made], seed=3) == score("judge", real, [made], seed=3)
    assert score("judge", real, [made], seed=3) != score("judge", real, [made], seed=4)


class Speed:
    """A judge that knows the speed of a walk and the number in its caption."""

    name = "speed"

    def embed_texts(self, texts):
        return np.array([[float(t.split()[-1]), 0.0] for t in texts])

    def embed_motions(self, motions):
        return np.array([[m.root_pos[-1, 0] / m.duration, 0.0] for m in motions])


def walks(count: int = 40) -> Clips:
    speeds = np.linspace(0.2, 1.6, count)
    return Clips(tuple(walk(v, seconds=1) for v in speeds), tuple(f"walk at {v}" for v in speeds))


def test_motions_in_figures_out() -> None:
    real = walks()
    told: list[tuple[int, int]] = []
    repeated = [[walk(v, seconds=1)] * 10 for v in (0.5, 1.0)]
    scores = evaluate(
        Speed(),
        real,
        lambda number: real,
        repeated=repeated,
        replications=3,
        passes=50,
        progress=lambda *at: told.append(at),
    )
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert [s.mean for s in scores.r_precision] == [1, 1, 1]
    assert scores.mm_dist.mean == pytest.approx(0, abs=1e-9)
    assert scores.fid.mean == pytest.approx(0, abs=1e-9)
    assert (scores.ranked, scores.passes, scores.diversity_pairs) == (32, 50, 40)
    assert scores.multimodality == Score(0.0, 0.0)
    by_hand = score("speed", embed(Speed(), real), [embed(Speed(), real)], replications=3)
    assert scores.r_precision == by_hand.r_precision


def test_captions_that_differ_in_case_alone_are_one_label() -> None:
    clip = walk(1.0, seconds=1)
    assert len(set(Clips((clip, clip), ("Walk  on", "walk on")).labels)) == 1


def test_actions() -> None:
    actions = {"walk": np.array([0.0, 0]), "bow": np.array([10.0, 0])}
    made = np.array([[1.0, 0], [2, 0], [9, 0], [4, 0]])
    found = score_actions(made, made, ["walk", "walk", "bow", "bow"], actions, replications=5)
    assert found.accuracy == 0.75
    assert found.fid == pytest.approx(0, abs=1e-9)
    assert 0 <= found.multimodality.mean <= 5
    with pytest.raises(ValueError, match="no embedding of action 'run'; there are bow, walk"):
        score_actions(made, made, ["walk", "walk", "bow", "run"], actions)
    with pytest.raises(ValueError, match="equally often"):
        score_actions(made, made, ["walk", "walk", "walk", "bow"], actions)


def test_the_table_has_a_cell_for_every_head() -> None:
    lines = table({"real": score("judge", embedded(0), [embedded(0)])}).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| real | ")


def other_skeleton() -> Motion:
    clip = motion(1, 30, {}, "stand")
    names = ("hips", *clip.skeleton.names[1:])
    return replace(clip, skeleton=Skeleton(names, clip.skeleton.parents, clip.skeleton.offsets))


class Broken(Speed):
    def embed_motions(self, motions):
        return np.full((len(motions), 2), np.nan)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Clips((walk(),), ("a", "b")), "1 motions, 2 captions and 2 labels"),
        (lambda: Clips((walk(),), ("a",), ("x", "y")), "1 motions, 1 captions and 2 labels"),
        (lambda: Clips((walk(),), (" ",)), "caption 0 is blank"),
        (lambda: Clips((other_skeleton(),), ("stand",)), r"motion 0, 'stand': skeleton of 22 joints \(hips, …\)"),
        (lambda: evaluate(Speed(), walks(31), walks(31)), "31 clips; R-precision needs at least 32"),
        (lambda: evaluate(Broken(), walks(), walks()), "motions: row 0 holds NaN"),
        (lambda: evaluate(Speed(), walks(), walks(), repeated=[[walk()], []]), "0 to 1 motions a text"),
        (lambda: score("j", embedded(0), [embedded(1)], passes=1000), "1000 denoising passes a motion"),
        (lambda: score("j", embedded(0), [embedded(1)] * 2), "2 draws for 20 replications"),
        (lambda: score("j", embedded(0), [embedded(1), embedded(2, 64)], replications=2), "different numbers of clips"),
        (lambda: Embedded(np.zeros((2, 3)), np.zeros((2, 3)), ("a",)), "1 labels for 2 clips"),
        (lambda: Embedded(np.zeros((2, 3)), np.zeros((2, 4)), ("a", "b")), "do not match"),
    ],
)
def test_bad_input_is_one_line(call, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
