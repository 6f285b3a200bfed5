"""Baselines and content judges on a small data set of gestures."""

from __future__ import annotations

import numpy as np
import pytest
from motions import does

from motiongen.data.dataset import Dataset, Entry, Head
from motiongen.evaluation.baselines import MeanPose, Retrieval
from motiongen.evaluation.language.discriminants import Discriminant, content_judge
from motiongen.features import motion_to_features
from motiongen.gestures.catalogue import perform
from motiongen.measure.clip import observe
from motiongen.text.claims import Claim


def test_a_discriminant_tells_what_differs() -> None:
    rng = np.random.default_rng(0)
    means = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    which = rng.integers(0, 3, 600)
    x = means[which] + rng.standard_normal((600, 3)) * [1, 1, 50]
    tells = Discriminant(x[:300], [f"class {i}" for i in which[:300]])
    right = np.mean([said == f"class {i}" for said, i in zip(tells(x[300:]), which[300:], strict=True)])
    assert right > 0.85  # the best possible is 0.91
    with pytest.raises(ValueError, match="two classes"):
        Discriminant(x, ["one"] * 600)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Eight performances each of a bow, a nod and a wave with the left hand, all of the training split."""
    entries, parts, start = [], [], 0
    for name, text, other in (("bow", "bow", "bow"), ("nod", "nod", "nod"), ("wave", "wave left", "wave right")):
        for seed in range(8):
            clip = perform(name, side="left" if name == "wave" else None, seed=seed)
            parts.append(motion_to_features(clip).astype(np.float16))
            bones = tuple((x, y, z) for x, y, z in clip.skeleton.offsets.tolist())
            entries.append(
                Entry(
                    f"{name}/{seed}",
                    "gestures",
                    "",
                    "CC0",
                    "train",
                    start,
                    len(parts[-1]),
                    (text,),
                    (other,),
                    name,
                    "",
                    bones,
                    clip.skeleton.foot_height,
                )
            )
            start += len(parts[-1])
    rows = np.concatenate(parts)
    mean, std = (tuple(y.tolist()) for y in (rows.mean(0, float), rows.std(0, float)))
    head = Head(1, ("gestures",), len(entries), finished=True, mean=mean, std=std)
    return Dataset(tmp_path_factory.mktemp("data"), head, tuple(entries), (), (0,) * len(entries), (rows,))


def test_retrieval_finds_the_clip_of_a_caption(data: Dataset) -> None:
    retrieval = Retrieval(data)
    assert retrieval.generate("nod").source.generator.startswith("nod/")
    assert does(Claim("wave", "left"), retrieval.generate("wave left"))
    assert does(Claim("wave", "right"), retrieval.generate("wave right"))  # of the mirror image
    assert retrieval.familiarity("please nod").nearest[0] == "nod"
    assert retrieval.familiarity("nod").score == pytest.approx(1, abs=1e-4)
    assert not retrieval.familiarity("the stock market crashed").known
    assert len({retrieval.generate("nod", seed=seed).source.generator for seed in range(12)}) > 3


def test_the_mean_pose_stands_still(data: Dataset) -> None:
    still = MeanPose(data).generate("wave", seconds=2)
    assert still.duration == pytest.approx(2)
    assert np.abs(np.diff(still.positions(), axis=0)).max() < 1e-9
    assert observe(still).events == ()


def test_judges_learn_contents(data: Dataset) -> None:
    new = [perform(name, seed=100) for name in ("bow", "nod", "wave")]
    assert content_judge(data)(new) == ["bow", "nod", "wave"]
