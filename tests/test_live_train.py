"""What a live network learns from: windows of clips and joined motions, its own histories, resuming, a file to run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from motiongen.data.build import build
from motiongen.data.dataset import Dataset
from motiongen.data.texts import data_texts
from motiongen.diffusion import lengths
from motiongen.diffusion.batches import scale_of
from motiongen.diffusion.configs import LiveConfig, MdmConfig, TrainConfig, require_sound
from motiongen.diffusion.export import export
from motiongen.diffusion.lessons import build as build_network
from motiongen.diffusion.named_configs import CONFIGS
from motiongen.diffusion.processes import Team
from motiongen.diffusion.train import Log, Watch, train
from motiongen.features import CONTACTS, FPS, motion_to_features
from motiongen.live import joined
from motiongen.live.generator import LiveGenerator
from motiongen.live.joined import Joined, Segment
from motiongen.live.objective import SETTLE, LiveObjective, load_live_share, settling
from motiongen.live.windows import Windows

LIVE = LiveConfig(chunk=36, motions=3, rollouts=1.0, truth=2)
SMALL = replace(
    CONFIGS["live"],
    model=MdmConfig(width=32, layers=1, heads=2, feed_forward=32, history=12, steering=12),
    live=LIVE,
    begin="",
    steps=6,
    batch=4,
    save_every=3,
    log_every=1,
)
ALONE = Team(0, 1, torch.device("cpu"))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return build(["gestures:16"], tmp_path_factory.mktemp("data") / "set")[0]


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch, data: Dataset) -> None:
    monkeypatch.setattr(lengths, "STEPS", 50)
    first = next(e.content for e in data.entries if e.split == "train")
    monkeypatch.setattr(joined, "IDLE", first)  # the first gestures have no idle clip


@pytest.fixture(scope="module")
def motions(data: Dataset) -> Joined:
    """Two motions: clips a and b one after the other, then b alone; what their features are does not matter here."""
    a, b = [i for i, e in enumerate(data.entries) if e.split == "train"][:2]
    rows = np.random.default_rng(0).standard_normal((300, 140)).astype(np.float16)
    return Joined(rows, (Segment(0, 90, a, 0), Segment(90, 180, b, 0), Segment(180, 300, b, 180)))


def windows(data: Dataset, motions: Joined, **changed: float) -> Windows:
    return Windows(data, motions, scale_of(data), size=16, history=12, live=replace(LIVE, **changed), seed=1)


def test_window_is_a_stretch_of_one_motion(data: Dataset, motions: Joined) -> None:
    """History and chunk of an unmirrored window are in the rows, in order, and no caption changes inside."""
    scale, found = scale_of(data), 0
    for number in range(4):
        batch = windows(data, motions).draw(number)
        for x, frames, caption in zip(batch.x * scale.std + scale.mean, batch.frames, batch.captions, strict=True):
            first = np.flatnonzero(np.abs(motions.features.astype(np.float32) - x[36 + 12]).max(1) < 0.01)
            if len(first) != 1:
                continue  # mirrored, or of a clip
            at, count = int(first[0]), int(frames[12:].sum())
            segment = next(s for s in motions.segments if s.start <= at < s.stop)
            assert caption in data.captions(segment.clip)
            assert count == min(36, segment.stop - at)
            assert np.abs(motions.features[at - 12 : at + count] - x[36 : 36 + 12 + count]).max() < 0.01
            found += 1
    assert found > 8


def test_window_depends_on_its_number_alone_and_shares_add_up(data: Dataset, motions: Joined) -> None:
    one, other = (windows(data, motions) for _ in range(2))
    one.draw(5)
    assert np.array_equal(one.draw(2).x, other.draw(2).x)
    half = other.draw(2, slice(1, None, 2))
    assert np.array_equal(half.x, one.draw(2).x[1::2])
    assert np.array_equal(half.whole, one.draw(2).whole)


def test_some_windows_forget_their_history(data: Dataset, motions: Joined) -> None:
    assert not windows(data, motions, no_history=1.0).draw(0).frames[:, :12].any()
    assert not windows(data, motions, no_history=1.0).draw(0).unbroken.any()
    assert windows(data, motions, no_history=0.0).draw(0).frames[:, :12].all()


def test_joined_clips_go_over_into_each_other(data: Dataset, tmp_path: Path) -> None:
    skeleton = data.motion(0).skeleton
    made = joined.open_joined(data, skeleton, tmp_path, count=3, seed=0)
    again = joined.open_joined(data, skeleton, tmp_path, count=3, seed=0)  # read, not made
    assert again.segments == made.segments
    assert np.array_equal(again.features, made.features)
    ends = [s.stop for s in made.segments]
    assert [0, *ends[:-1]] == [s.start for s in made.segments]
    assert ends[-1] == len(made.features)
    assert all(data.entries[s.clip].split == "train" for s in made.segments)
    rows = made.features.astype(float)
    for segment in made.segments:
        if segment.start != segment.motion:
            jump = np.abs(np.diff(rows[segment.start - 2 : segment.start + 2, 4:136], axis=0)).max() * FPS
            assert jump < 15.0  # rad/s: no faster than people are


def test_clip_begins_shortly_before_it_moves(data: Dataset) -> None:
    clip = motion_to_features(data.motion(0))
    still = np.concatenate([np.repeat(clip[:1], 30, axis=0), clip])
    assert joined._begins(still) == joined._begins(clip) + 30 or joined._begins(clip) == 0


def test_offset_dies_away_from_its_place_at_its_rate() -> None:
    off = torch.zeros(1, 2, 140)
    off[0, :, 5] = torch.tensor([0.10, 0.12])
    off[0, :, CONTACTS] = 1.0
    made = settling(off, 40)[0]
    fine = torch.linspace(0, 1, SETTLE + 1)[1:]
    hermite = 0.12 * (2 * fine**3 - 3 * fine**2 + 1) + SETTLE * 0.02 * (fine**3 - 2 * fine**2 + fine)
    assert torch.allclose(made[:SETTLE, 5], hermite, atol=1e-6)
    assert made[0, 5] - 0.12 == pytest.approx(0.02, abs=0.01)
    assert not made[SETTLE:].any()
    assert not made[:, CONTACTS].any()


def objective(data: Dataset, motions: Joined, config: TrainConfig) -> tuple[LiveObjective, Windows, torch.nn.Module]:
    torch.manual_seed(0)
    model = build_network(config.model)
    assert config.live is not None
    source = Windows(data, motions, scale_of(data), size=config.batch, history=12, live=config.live, seed=0)
    return LiveObjective(config, model, scale_of(data), ALONE), source, model


def test_own_histories_are_shown_after_the_first_steps(data: Dataset, motions: Joined) -> None:
    config = replace(SMALL, batch=24)
    _, source, _ = objective(data, motions, config)
    texts = data_texts(data, source.captions())
    early, late = (load_live_share(source, texts, config, ALONE, step) for step in (1, 3))
    assert not len(early.rolled)
    assert len(late.rolled) > 2
    assert late.before is not None
    assert len(late.before[0]) == len(late.rolled)


def test_own_history_differs_from_the_true_one_and_the_target_settles(data: Dataset, motions: Joined) -> None:
    config = replace(SMALL, batch=24)
    learner, source, _ = objective(data, motions, config)
    share = load_live_share(source, data_texts(data, source.captions()), config, ALONE, 3)
    past, truth = share.x[:, 36:48], share.x[:, 48:]
    torch.manual_seed(0)
    drawn, target = learner._rolled(share, past, truth, 12, 36)
    rolled = torch.zeros(24, dtype=torch.bool).index_fill(0, share.rolled, True)
    assert torch.equal(drawn[~rolled], past[~rolled])
    assert torch.equal(target[~rolled], truth[~rolled])
    assert (drawn[rolled] - past[rolled]).abs().amax((1, 2)).min() > 0.1
    assert torch.allclose(target[rolled][:, SETTLE:], truth[rolled][:, SETTLE:], atol=1e-5)
    turns = slice(4, 136)
    step = (target[rolled][:, 0] - drawn[rolled][:, -1] - truth[rolled][:, 0] + past[rolled][:, -1])[:, turns]
    off = (drawn - past)[rolled][:, -2:, turns]
    assert (step - (settling((drawn - past)[rolled][:, -2:], 1)[:, 0, turns] - off[:, 1])).abs().max() < 1e-5


def test_what_the_network_says_of_the_history_does_not_count(data: Dataset, motions: Joined) -> None:
    learner, source, model = objective(data, motions, replace(SMALL, drop_text=0.0))
    share = load_live_share(source, data_texts(data, source.captions()), SMALL, ALONE, 0)
    plain = learner.differentiate(0, share)
    network = learner._network
    learner._network = lambda x, *rest: torch.cat([network(x, *rest)[:, :12] + 9.0, network(x, *rest)[:, 12:]], dim=1)
    assert learner.differentiate(0, share) == plain
    learner._network = lambda x, *rest: network(x, *rest) + 9.0
    assert learner.differentiate(0, share)["total"] > plain["total"] + 1
    assert any(p.grad is not None and p.grad.abs().sum() > 0 for p in model.parameters())


def stopped_by(log: Log) -> None:
    if log.step == 5:
        raise KeyboardInterrupt


def test_resumed_training_is_the_same_as_unbroken_and_exports(data: Dataset, tmp_path: Path) -> None:
    train(SMALL, data, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(SMALL, data, tmp_path / "parts", Watch(logged=stopped_by))
    train(SMALL, data, tmp_path / "parts")
    whole, parts = (load_file(tmp_path / run / "checkpoint.safetensors") for run in ("whole", "parts"))
    assert int(parts["step"]) == 6
    assert all(np.array_equal(whole[k], parts[k]) for k in whole)
    made = export(data, tmp_path / "whole", tmp_path / "live.safetensors")
    assert made.window == 12 + 36
    assert len(LiveGenerator(tmp_path / "live.safetensors").next_chunk()) == 30

    begun = replace(SMALL, begin=str(tmp_path / "live.safetensors"), steps=1, rate=1e-9, warm_up=0)
    train(begun, data, tmp_path / "begun")
    found = load_file(tmp_path / "begun" / "checkpoint.safetensors")
    assert found["model.read.weight"] == pytest.approx(made.tensors["read.weight"], abs=1e-6)
    wider = replace(begun, model=replace(begun.model, width=64))
    with pytest.raises(ValueError, match=r"begin .*live.safetensors: \S+ is .*, not "):
        train(wider, data, tmp_path / "wider")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"live": None}, "live and model.history go together"),
        ({"live": replace(LIVE, chunk=6)}, "live.chunk 6 and model.history 12"),
        ({"live": replace(LIVE, chunk=40)}, "multiples of 6"),
        ({"live": replace(LIVE, rollouts=1.5)}, "live.rollouts must be 0 to 1, not 1.5"),
        ({"by_action": 0.1}, "by_action 0"),
        ({"show_every": 5}, "show_every 0"),
    ],
)
def test_unsound_configs_are_refused(changed: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        require_sound(replace(SMALL, **changed))
