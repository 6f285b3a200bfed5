"""Batches of a small data set of gestures, the vectors of their captions, and lengths learnt from them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from motiongen.data import texts
from motiongen.data.build import build
from motiongen.data.dataset import Dataset
from motiongen.diffusion import batches as drawing
from motiongen.diffusion.batches import LONGEST, Batches, scale_of
from motiongen.diffusion.lengths import fit_lengths, usual_seconds
from motiongen.motion import SMPL_JOINTS
from motiongen.text.encoder import TextEncoder


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return build(["gestures:24"], tmp_path_factory.mktemp("data") / "set")[0]


def test_a_batch_depends_on_its_number_alone(data: Dataset) -> None:
    one, other = (Batches(data, scale_of(data), size=4, patch=6, seed=1) for _ in range(2))
    later = other.draw(9)
    assert np.array_equal(one.draw(3).x, other.draw(3).x)
    assert np.array_equal(one.draw(9).x, later.x)
    assert one.draw(9).captions == later.captions
    assert not np.array_equal(one.draw(3).x[:, :12], one.draw(4).x[:, :12])


def test_only_training_clips_with_their_own_captions_are_drawn(data: Dataset) -> None:
    scale = scale_of(data)
    batches = Batches(data, scale, size=6, patch=6, seed=0)
    clips = {}
    for i, entry in enumerate(data.entries):
        for mirrored in (False, True):
            clips[i, mirrored] = (data.features(i, mirrored), data.captions(i, mirrored), entry.split)
    for number in range(8):
        batch = batches.draw(number)
        for x, frames, caption in zip(batch.x, batch.frames, batch.captions, strict=True):
            drawn = x[frames] * scale.std + scale.mean
            same = [c for c in clips.values() if c[0].shape == drawn.shape and np.abs(c[0] - drawn)[:, 4:].max() < 2e-2]
            assert any(caption in said and split == "train" for _, said, split in same)
            assert not x[~frames].any()


def test_a_long_leg_walks_as_far_as_the_scales(data: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    scale = scale_of(data)
    legs = [SMPL_JOINTS.index(n) for n in ("left_knee", "left_ankle", "right_knee", "right_ankle")]
    longer = np.array(scale.offsets)
    longer[legs] *= 2.0
    usual = Batches(data, scale, size=4, patch=6, seed=1).draw(0).x * scale.std + scale.mean
    taller = Batches(data, replace(scale, offsets=longer), size=4, patch=6, seed=1).draw(0).x * scale.std + scale.mean
    frames = Batches(data, scale, size=4, patch=6, seed=1).draw(0).frames
    np.testing.assert_allclose(taller[frames][:, 1:4], 2.0 * usual[frames][:, 1:4], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(taller[frames][:, 4:], usual[frames][:, 4:], atol=1e-5)


def test_what_is_cut_short_says_no_number(data: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "CUT", ("gestures",))
    whole = {e.frames for e in data.entries}
    cut = [
        (batch.frames[b].sum(), batch.captions[b])
        for batch in (Batches(data, scale_of(data), size=8, patch=6, seed=0).draw(n) for n in range(8))
        for b in range(8)
        if batch.frames[b].sum() not in whole
    ]
    assert len(cut) > 3
    assert not [c for _, c in cut if any(f" {n}" in f" {c}" for n in ("two", "twice", "three", "four", "five", "once"))]
    assert max(frames for frames, _ in cut) <= LONGEST


def test_vectors_of_texts_are_the_encoders(tmp_path: Path) -> None:
    said = ["nod", "wave with the right hand", "clap five times", "nod"]
    for part in (said[:2], said, said):  # some encoded, the rest encoded, all read
        vectors = texts.encode_texts(part, tmp_path)
        if len(part) < len(said):
            continue
        words, mask, sentences = vectors.batch(said)
        for i, caption in enumerate(said):
            alone = TextEncoder()([caption])
            np.testing.assert_allclose(words[i][mask[i]], alone[0][0], atol=2e-3)
            np.testing.assert_allclose(sentences[i], alone[2][0], atol=1e-5)
    assert len(list(tmp_path.iterdir())) == 8


def test_lengths_are_learnt_from_texts() -> None:
    said = [f"clap {n} times" for n in ("two", "three", "four", "five", "six", "seven")]
    sentences, seconds = TextEncoder()(said)[2], np.arange(2.0, 8.0)
    np.testing.assert_allclose(usual_seconds(fit_lengths(sentences, seconds), sentences), seconds, rtol=0.1)


def test_parts_of_the_cache_are_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = [f"clap {n} times and then {what}" for n in range(40) for what in ("bow", "sit down", "walk", "nod")]
    monkeypatch.setattr(texts, "_PART_BYTES", 100_000)
    monkeypatch.setattr(texts, "_BATCH", 8)
    many = texts.encode_texts(said, tmp_path)
    assert len(many.parts) > 5
    assert max(path.stat().st_size for path in tmp_path.iterdir()) < 101_000
    words, mask, sentences = many.batch(said[::50])
    for i, caption in enumerate(said[::50]):
        alone = TextEncoder()([caption])
        np.testing.assert_allclose(words[i][mask[i]], alone[0][0], atol=2e-3)
        np.testing.assert_allclose(sentences[i], alone[2][0], atol=1e-5)


def test_shares_of_a_batch_make_it_up(data: Dataset) -> None:
    batches = Batches(data, scale_of(data), size=5, patch=6, seed=0)
    whole, *shares = (batches.draw(2, share) for share in (slice(None), slice(0, None, 2), slice(1, None, 2)))
    assert [len(share.x) for share in shares] == [3, 2]
    for i, share in enumerate(shares):
        assert np.array_equal(share.x, whole.x[i::2])
        assert np.array_equal(share.whole, whole.frames)
        assert share.captions == whole.captions[i::2]
