"""The part of a data set that may be used commercially, clip by clip, by the licence that each one carries."""

from __future__ import annotations

from dataclasses import replace

from motiongen.data.dataset import Dataset, DatasetError, statistics
from motiongen.gestures.catalogue import LICENCE as OURS
from motiongen.skeletons import CMU

FREE = (OURS, CMU.licence)
"""Licences that allow commercial use. What is not listed is taken as not allowing it."""


def licences(licence: str) -> list[str]:
    """The licences of an entry: a clip that is composed of several has those of all of them."""
    return sorted(set(licence.split("; ")))


def free_only(data: Dataset) -> Dataset:
    """The clips of `data` whose every licence is one of `FREE`, with statistics of their own.

    Raises DatasetError where none of the training split is left, naming the licences that there are.
    """
    kept = [i for i, e in enumerate(data.entries) if set(licences(e.licence)) <= set(FREE)]
    entries = tuple(data.entries[i] for i in kept)
    training = [i for i in kept if data.entries[i].split == "train"]
    if not training:
        there = sorted({each for e in data.entries for each in licences(e.licence)})
        raise DatasetError(f"{data.folder}: no training clip is free for commercial use; licences: {'; '.join(there)}")
    mean, std = statistics(data.features(i) for i in training)
    head = replace(data.head, mean=mean, std=std)
    return replace(data, head=head, entries=entries, shard_of=tuple(data.shard_of[i] for i in kept))
