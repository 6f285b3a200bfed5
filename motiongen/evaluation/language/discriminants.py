"""Judges of what cannot be measured by rule: content and style, told by linear discriminants of a clip's statistics.

They learn from the training split of a data set and its mirror images, in seconds, without torch. What they are worth
is their accuracy on held-out clips (`python -m motiongen.evaluation.language.run --generator real`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from motiongen.data.dataset import Dataset
from motiongen.evaluation.language.prompts import STYLES, family
from motiongen.evaluation.language.run import Judge
from motiongen.features import HEIGHT, motion_to_features
from motiongen.motion import Motion
from motiongen.rotation import Array

SHRINKAGE = 0.2  # of the covariance towards a multiple of the identity: more statistics than a rare class has clips
LEAST = 8  # clips of a class to learn it from, mirror images counted
STYLED = ("walk", "run", "wave", "raise-arm")  # families of which every style was captured often
EDGE = 0.1  # share at either end of a clip, where generated ones may not start from a stand


class Discriminant:
    """Fisher's linear discriminant for many classes, each equally likely beforehand.

    Raises ValueError where there are fewer than two classes to tell apart.
    """

    def __init__(self, vectors: Array, labels: Sequence[str]) -> None:
        self.labels = tuple(sorted(set(labels)))
        if len(self.labels) < 2:
            raise ValueError(f"a judge needs two classes or more to tell apart, not {', '.join(self.labels) or 'none'}")
        self._centre, self._scale = vectors.mean(0), vectors.std(0) + 1e-3
        x, which = self._scaled(vectors), np.array([self.labels.index(label) for label in labels])
        means = np.stack([x[which == i].mean(0) for i in range(len(self.labels))])
        # Each class weighs the same, however many clips it has.
        weight = 1.0 / np.bincount(which)[which]
        apart = (x - means[which]) * np.sqrt(weight / weight.sum())[:, None]
        inside = apart.T @ apart
        level = np.trace(inside) / len(inside)
        inside = (1 - SHRINKAGE) * inside + SHRINKAGE * level * np.eye(len(inside))
        self._weights = np.linalg.solve(inside, means.T)
        self._bias = -0.5 * np.sum(means.T * self._weights, axis=0)

    def __call__(self, vectors: Array) -> list[str]:
        """The likeliest class of every row."""
        return [self.labels[i] for i in np.argmax(self._scaled(vectors) @ self._weights + self._bias, axis=1)]

    def _scaled(self, vectors: Array) -> Array:
        return (vectors - self._centre) / self._scale


def content_judge(dataset: Dataset) -> Judge:
    """A judge that names a motion's family of content, see `prompts.family`."""
    return _judge(dataset, lambda content, style: family(content) if content else "")


def style_judge(dataset: Dataset) -> Judge:
    """A judge that names the style of walks, runs, waves and raised hands. It tells content and style apart together,
    since what is brisk in a wave is not so in a run."""

    def label(content: str, style: str) -> str:
        return f"{family(content)} {style}" if family(content) in STYLED and style in (*STYLES, "normal") else ""

    judge = _judge(dataset, label)
    return lambda motions: [said.split()[1] for said in judge(motions)]


def _judge(dataset: Dataset, label: Callable[[str, str], str]) -> Judge:
    rows, labels = [], []
    for i, entry in enumerate(dataset.entries):
        name = label(entry.content, entry.style)
        if entry.split == "train" and name:
            for mirrored in (False, True):
                rows.append(statistics(dataset.features(i, mirrored)))
                labels.append(name)
    enough = [labels.count(name) >= LEAST for name in labels]
    tells = Discriminant(np.array(rows)[enough], [name for name, yes in zip(labels, enough, strict=True) if yes])

    def judge(motions: list[Motion]) -> list[str]:
        return tells(np.stack([statistics(motion_to_features(motion)) for motion in motions]))

    return judge


def statistics(features: NDArray[np.floating]) -> Array:
    """(700,) of features (T, 140): mean, deviation, two extreme quantiles and mean speed of each column."""
    features = np.array(features, float)
    features[:, HEIGHT] -= np.quantile(features[:, HEIGHT], 0.9)  # how tall somebody is says nothing
    low, high = np.quantile(features, [EDGE / 2, 1 - EDGE / 2], axis=0)
    speed = np.abs(np.diff(features, axis=0)).mean(0) if len(features) > 1 else np.zeros(features.shape[1])
    return np.concatenate([features.mean(0), features.std(0), low, high, speed])
