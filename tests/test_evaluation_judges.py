"""The evaluators: what they see, what padding and order may not change, what is a negative, training and files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from motions import motion, skeleton, squat, turned, walk, wave

from motiongen.data.build import build as build_data
from motiongen.evaluation.judges.batches import Batches, statistics
from motiongen.evaluation.judges.guo import margin_loss
from motiongen.evaluation.judges.judge import About, Judge, JudgeError, build, load_judge, save_judge
from motiongen.evaluation.judges.negatives import may_be_same, telling
from motiongen.evaluation.judges.sanity import held_out, noise, sanity
from motiongen.evaluation.judges.seen import MOST_FRAMES, SEEN_FPS, leg_length, mirror_seen, see, see_motion
from motiongen.evaluation.judges.tmr import info_nce
from motiongen.evaluation.judges.train import JUDGE, TrainConfig, train
from motiongen.evaluation.protocol import Clips
from motiongen.features import MIRRORED_JOINT, mirror, motion_to_features
from motiongen.motion import SMPL_JOINTS, Motion, Skeleton
from motiongen.rotation import quat_conj, quat_rotate, yaw_of_quat, yaw_quat
from motiongen.smpl import SMPL_SKELETON

SMALL = {
    "guo": {"movement": 24, "motion": 24, "text": 24, "latent": 32},
    "tmr": {"width": 32, "layers": 2, "heads": 2, "feed_forward": 48, "latent": 32},
}
KINDS = ("guo", "tmr")


@pytest.fixture(scope="module", params=KINDS)
def judge(request: pytest.FixtureRequest) -> Judge:
    torch.manual_seed(0)
    about = About(request.param, SMALL[request.param], ("gestures",), ("Apache-2.0",), 0, 0)
    clips = [see_motion(c) for c in (walk(), wave("left"), squat())]
    return Judge(about, build(about.kind, about.config), *statistics(clips))


# ---- What is seen


def test_what_is_seen_are_the_joints_of_the_standard_body() -> None:
    clip = replace(turned(walk(1.2, seconds=2), 0.7, np.array([1.0, 2, 0])), skeleton=SMPL_SKELETON)
    seen = see_motion(clip)
    where = clip.positions()[::2]
    level = quat_conj(yaw_quat(yaw_of_quat(clip.global_quat()[::2, 0])))
    places = quat_rotate(level[:, None], where - where[:, :1])[:, 1:]
    assert seen.shape == (31, 71)
    assert SEEN_FPS == 15
    assert np.allclose(seen[:, 4:67].reshape(-1, 21, 3), places, atol=1e-5)
    assert np.allclose(seen[:, 3], where[:, 0, 2], atol=1e-6)
    assert seen[:-1, 1].mean() == pytest.approx(1.2, abs=1e-3)


def test_neither_place_nor_heading_nor_size_is_seen() -> None:
    clip = walk(1.2, seconds=2)
    seen = see_motion(clip)
    elsewhere = see_motion(turned(clip, -2.0, np.array([5.0, -3, 0])))
    assert np.allclose(seen, elsewhere, atol=1e-4)
    body = clip.skeleton
    child = replace(
        clip,
        root_pos=clip.root_pos * 0.6,
        skeleton=Skeleton(SMPL_JOINTS, body.parents, body.offsets * 0.6, (0.6 * 0.08, 0.6 * 0.02)),
    )
    assert np.allclose(seen[:, :67], see_motion(child)[:, :67], atol=1e-4)
    assert leg_length(body.offsets) == pytest.approx(0.81)


def test_the_mirror_image_is_seen_mirrored() -> None:
    clip = wave("left")
    features, offsets = motion_to_features(clip), skeleton().offsets
    other = offsets[MIRRORED_JOINT] * [1, -1, 1]
    assert np.allclose(mirror_seen(see(features, offsets)), see(mirror(features), other), atol=1e-5)
    assert np.array_equal(mirror_seen(mirror_seen(see(features, offsets))), see(features, offsets))


# ---- Judges


def test_neighbours_padding_and_order_change_nothing(judge: Judge) -> None:
    clips = [walk(1.0, seconds=s) for s in (1.0, 6.3, 2.1, 12.0, 4.0)] + [squat(3), wave("right")]
    together = judge.embed_motions(clips)
    alone = np.concatenate([judge.embed_motions([clip]) for clip in clips])
    assert np.allclose(together, alone, atol=1e-5)
    assert np.allclose(judge.embed_motions(clips[::-1])[::-1], together, atol=1e-5)
    assert np.ptp(together, axis=0).max() > 1e-3
    texts = ["a person walks", "wave", "a person bows deeply and then waves with the left hand four times", "jump"]
    each = np.concatenate([judge.embed_texts([text]) for text in texts])
    assert np.allclose(judge.embed_texts(texts), each, atol=1e-5)
    assert np.allclose(judge.embed_texts(texts[::-1])[::-1], each, atol=1e-5)


def test_only_the_first_eight_seconds_are_seen(judge: Judge) -> None:
    long = walk(1.0, seconds=12)
    assert len(see_motion(long)) == MOST_FRAMES == 120
    later = long.joint_quat.copy()
    later[260:, 16] = [0.0, 1, 0, 0]
    assert np.allclose(judge.embed_motions([long]), judge.embed_motions([replace(long, joint_quat=later)]), atol=1e-6)
    earlier = long.joint_quat.copy()
    earlier[100:, 16] = [0.0, 1, 0, 0]
    assert not np.allclose(judge.embed_motions([long]), judge.embed_motions([replace(long, joint_quat=earlier)]))


def test_a_judge_comes_back_from_its_file(judge: Judge, tmp_path: Path) -> None:
    path = tmp_path / "judge.safetensors"
    save_judge(judge, path)
    again = load_judge(path)
    assert again.about == judge.about
    clips = [walk(), squat()]
    assert np.array_equal(again.embed_motions(clips), judge.embed_motions(clips))
    assert np.array_equal(again.embed_texts(["bow"]), judge.embed_texts(["bow"]))
    with pytest.raises(JudgeError, match="no such file"):
        load_judge(tmp_path / "none.safetensors")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(JudgeError, match="damaged"):
        load_judge(path)


def test_bad_motions_and_texts_are_one_line(judge: Judge) -> None:
    with pytest.raises(ValueError, match="text 1 is blank"):
        judge.embed_texts(["walk", "  "])
    with pytest.raises(ValueError, match="motion 0 has 2 frames at 15 a second"):
        judge.embed_motions([walk(seconds=0.1)])
    clip = motion(1, 30, {}, "stand")
    names = ("hips", *SMPL_JOINTS[1:])
    other = replace(clip, skeleton=Skeleton(names, clip.skeleton.parents, clip.skeleton.offsets))
    with pytest.raises(ValueError, match="22 joints of SMPL"):
        judge.embed_motions([other])
    with pytest.raises(ValueError, match="nothing to embed"):
        judge.embed_motions([])


# ---- Losses and negatives


def test_margin_loss_by_hand() -> None:
    text, moving = torch.tensor([[0.0], [4.0], [30.0]]), torch.tensor([[1.0], [6.0], [30.0]])
    none = torch.eye(3, dtype=torch.bool)
    own, short = (1 + 4 + 0) / 3, [10 - 6, 10 - 3]  # text 0 to motion 1, text 1 to motion 0; the rest are far enough
    assert margin_loss(text, moving, none).item() == pytest.approx(own + (short[0] ** 2 + short[1] ** 2) / 2)
    same = none.clone()
    same[0, 1] = same[1, 0] = True
    assert margin_loss(text, moving, same).item() == pytest.approx(own)


def test_info_nce_by_hand() -> None:
    text, moving = F.normalize(torch.randn(3, 4), dim=1), F.normalize(torch.randn(3, 4), dim=1)
    same = torch.eye(3, dtype=torch.bool)
    same[0, 1] = same[1, 0] = True
    e = np.exp((text @ moving.T).double().numpy() / 0.1)
    rows = [e[0, 0] / (e[0, 0] + e[0, 2]), e[1, 1] / (e[1, 1] + e[1, 2]), e[2, 2] / e[2].sum()]
    columns = [e[0, 0] / (e[0, 0] + e[2, 0]), e[1, 1] / (e[1, 1] + e[2, 1]), e[2, 2] / e[:, 2].sum()]
    assert info_nce(text, moving, same).item() == pytest.approx(-np.log(rows + columns).mean(), rel=1e-4)


def test_sides_and_numbers_are_always_negatives() -> None:
    captions = ["wave with the left hand", "wave with the right hand", "wave", "wave twice", "wave three times", "wave"]
    same = may_be_same(captions, ["wave/"] * 6, telling(captions))
    assert not same[0, 1]
    assert not same[3, 4]
    assert same[0, 2]  # who just waves may wave with the left
    assert same[0, 3]
    assert same.diagonal().all()
    assert np.array_equal(same, same.T)


def test_equal_captions_labels_and_like_sentences_are_no_negatives() -> None:
    captions = ["a", "a", "b", "c", "d"]
    sentences = np.array([[1, 0], [0, 1], [0.6, 0.8], [0.8, 0.6], [0, 1.0]])
    plain = may_be_same(captions, ["", "", "x", "x", ""], telling(captions))
    assert [tuple(p) for p in np.argwhere(np.triu(plain, 1))] == [(0, 1), (2, 3)]
    heard = may_be_same(captions, [""] * 5, telling(captions), sentences)
    assert [tuple(p) for p in np.argwhere(np.triu(heard, 1))] == [(0, 1), (0, 3), (1, 2), (1, 4), (2, 3), (2, 4)]


# ---- Training


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory):
    return build_data(["gestures:90"], tmp_path_factory.mktemp("data") / "gestures")[0]


def test_a_draw_depends_on_its_step_alone(data, tmp_path: Path) -> None:
    one, two = (Batches(data, "guo", 16, 3) for _ in range(2))
    two.draw(0)
    (x, frames), (words, mask), same = one.draw(5)
    (y, frames2), (words2, _), same2 = two.draw(5)
    assert torch.equal(x, y)
    assert torch.equal(frames, frames2)
    assert torch.equal(words, words2)
    assert torch.equal(same, same2)
    assert not torch.equal(one.draw(6)[0][0][:, :8], x[:, :8])
    assert (x.shape[0], x.shape[2], words.shape[2]) == (16, 71, 384)
    assert x.shape[1] % 4 == 0
    for row, count in zip(x, frames, strict=True):
        assert count % 4 == 0
        assert not row[count:].any()
    assert mask.any(1).all()


@pytest.mark.parametrize("kind", KINDS)
def test_training_learns_and_goes_on_from_a_checkpoint(
    kind, data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("motiongen.evaluation.judges.train.default_config", SMALL.__getitem__)
    config = TrainConfig(kind, steps=30, batch=16, warm_up=3, save_every=15)
    whole = train(data, tmp_path / "whole", config)
    monkeypatch.setattr("motiongen.evaluation.judges.train._schedule", lambda step, _: _whole_schedule(step, config))
    train(data, tmp_path / "parts", replace(config, steps=15))
    parts = train(data, tmp_path / "parts", config)
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, parts.network.state_dict()[name]), name
    fresh = build(kind, SMALL[kind])
    rows = [i for i, e in enumerate(data.entries) if e.split == "train"][:40]
    motions, texts = [data.motion(i) for i in rows], [data.captions(i)[0] for i in rows]

    def own_rank(judge: Judge) -> float:
        apart = np.linalg.norm(judge.embed_texts(texts)[:, None] - judge.embed_motions(motions)[None], axis=-1)
        return float((apart < np.diag(apart)[:, None]).mean())

    untrained = Judge(whole.about, fresh, whole.mean, whole.std)
    if kind == "tmr":  # the margin loss of "guo" stays on its first plateau for longer than a test may take
        assert own_rank(load_judge(tmp_path / "whole" / JUDGE)) < min(0.35, own_rank(untrained))
    with pytest.raises(ValueError, match="of another network"):
        train(data, tmp_path / "whole", replace(config, kind="tmr" if kind == "guo" else "guo"))


def _whole_schedule(step: int, config: TrainConfig) -> float:
    return min(1.0, (step + 1) / config.warm_up) * 0.5 * (1 + np.cos(np.pi * step / config.steps))


def test_too_few_clips_to_train_on(data, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="training clips, fewer than a batch of 640"):
        train(data, tmp_path, TrainConfig(batch=640))


# ---- Sanity


class Oracle:
    """Knows every clip by its length and place of its hand, and every caption by the clip it was drawn for."""

    name = "oracle"

    def __init__(self, clips) -> None:
        self._of = dict(zip(clips.captions, map(self._see, clips.motions), strict=True))

    @staticmethod
    def _see(clip: Motion) -> np.ndarray:
        return clip.positions()[len(clip) // 2, [20, 21]].ravel() + len(clip) / 100

    def embed_texts(self, texts):
        return np.stack([self._of[t] for t in texts])

    def embed_motions(self, motions):
        return np.stack([self._see(m) for m in motions])


def test_the_sanity_table_tells_real_from_shuffled_from_noise() -> None:
    clips = tuple(walk(v, seconds=s) for v in np.linspace(0.3, 1.5, 10) for s in np.linspace(1, 2, 10))
    tested = Clips(clips, tuple(f"clip {i}" for i in range(100)))
    found = sanity(Oracle(tested), tested)
    assert found["real"].r_precision[0].mean == 1
    assert found["captions shuffled"].r_precision[0].mean < 0.2
    assert found["captions shuffled"].fid.mean == pytest.approx(found["real"].fid.mean, rel=1e-6)
    assert found["noise"].fid.mean > 20 * found["real"].fid.mean
    assert found["noise"].precision.mean < 0.2 < found["real"].precision.mean


def test_held_out_clips_are_of_the_split_and_labelled_by_content(data) -> None:
    found = held_out(data)
    rows = [i for i, e in enumerate(data.entries) if e.split == "test"]
    assert len(found.motions) == len(rows)
    assert found.labels == tuple(f"{data.entries[i].content}/" for i in rows)
    for i, caption in zip(rows, found.captions, strict=True):
        assert caption in data.captions(i)
    assert len(noise(found.motions[:2])[0]) == len(found.motions[0])
