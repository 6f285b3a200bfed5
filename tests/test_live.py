"""The live generator on a network that has learnt nothing: what follows from what, what is refused, where it goes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from live_weights import CHUNK, SIZES, live_weights

from motiongen.diffusion import mdm_run, said
from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.diffusion.mdm import Mdm
from motiongen.diffusion.weights import FOLDER, WeightsError, load_weights
from motiongen.features import FPS, HEIGHT, features_to_motion, motion_to_features
from motiongen.generator import PromptError
from motiongen.live.chunk import HAND_OVER, TAIL, after, handed_over
from motiongen.live.clips import LiveClips
from motiongen.live.generator import PAST_S, LiveGenerator
from motiongen.live.steering import HANDS, HANDS_GIVEN, REACH_S, ROOT, ROOT_GIVEN, STROLL, WRISTS, Area, Steer, signals
from motiongen.motion import Motion
from motiongen.nn import in_panels

WHOLE = CHUNK - TAIL


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return live_weights(tmp_path_factory.mktemp("weights") / "live.safetensors")


@pytest.fixture
def live(path: Path) -> LiveGenerator:
    return LiveGenerator(path)


def drawn(live: LiveGenerator, until: int) -> tuple[np.ndarray, np.ndarray]:
    """Root and joints of the frames up to `until`, drawn chunk by chunk."""
    motions = []
    while live.frame < until:
        motions.append(live.next_chunk())
    count = until - live.frame + sum(map(len, motions))
    return tuple(np.concatenate([getattr(m, name) for m in motions])[:count] for name in ("root_pos", "joint_quat"))


@pytest.mark.parametrize("panels", [False, True])
def test_steering_in_numpy_is_as_in_torch(panels: bool) -> None:
    torch.manual_seed(1)
    model = Mdm(SIZES).eval()
    for p in model.parameters():
        torch.nn.init.normal_(p, std=0.1)
    x, steering = torch.randn(2, 78, 140), torch.randn(2, 78, 12)
    frames, words, sentence = torch.ones(2, 78, dtype=torch.bool), torch.randn(2, 5, 384), torch.randn(2, 384)
    mask, keep = torch.ones(2, 5, dtype=torch.bool), torch.tensor([True, False])
    with torch.inference_mode():
        true = model(x, torch.full((2,), 0.4), frames, words, mask, sentence, keep, None, steering).numpy()
        plain = model(x, torch.full((2,), 0.4), frames, words, mask, sentence, keep).numpy()
    told = said.Said(words.numpy(), mask.numpy(), sentence.numpy(), keep.numpy())
    w = {k: v.numpy() for k, v in model.state_dict().items()}
    w = in_panels(w, 28) if panels else w
    assert (w["read.weight"].ndim == 3) == panels
    ours = mdm_run.denoise(w, {"patch": 6, "heads": 2}, x.numpy(), 0.4, frames.numpy(), told, steering.numpy())
    assert np.abs(ours - true).max() < 1e-4
    assert np.abs(plain - true).max() > 0.1


def test_frames_join_into_the_motion_of_all_features(live: LiveGenerator) -> None:
    """What is kept for world coordinates between chunks adds up to what one clip of all features would do."""
    live.say("walk forward", 50)
    pos, quat = drawn(live, 110)
    counts = np.diff([s.frame for s in live._states])
    rows = np.concatenate([chunk.features[:n] for chunk, n in zip(live._chunks, counts, strict=True)])
    whole = features_to_motion(rows, live.skeleton)
    assert np.abs(whole.root_pos[:110] - pos).max() < 1e-5
    assert np.abs((whole.joint_quat[:110] * quat).sum(-1)).min() > 1 - 1e-9


def test_same_for_same_seed_and_prompts(path: Path) -> None:
    def told(seed: int, at: int) -> np.ndarray:
        live = LiveGenerator(path, seed=seed)
        live.say("wave with the right hand", at)
        return drawn(live, 90)[1]

    assert np.array_equal(told(3, 20), told(3, 20))
    assert not np.allclose(told(3, 20), told(4, 20), atol=1e-3)
    assert np.array_equal(told(3, 20)[:20], told(3, 40)[:20])
    assert not np.allclose(told(3, 20), told(3, 40), atol=1e-3)


def test_prompt_for_frames_drawn_already_draws_them_anew(path: Path) -> None:
    early, late = LiveGenerator(path), LiveGenerator(path)
    early.say("nod", 20)
    late.next_chunk()
    assert late.frame == WHOLE
    late.say("nod", 20)
    assert late.frame == 20
    first, second = drawn(early, 80), drawn(late, 80)
    assert np.array_equal(first[1][20:], second[1][-60:])


def test_first_frames_of_a_chunk_leave_a_state_to_go_on_from(live: LiveGenerator) -> None:
    live.next_chunk()
    chunk = live._chunks[0]
    assert after(chunk, 0) is chunk.start
    assert np.array_equal(after(chunk, 10).history, chunk.features[:10])
    with pytest.raises(ValueError, match=f"0 to the chunk's {WHOLE}"):
        after(chunk, WHOLE + 1)


def test_prompt_lasts_as_long_as_asked_then_idle(live: LiveGenerator) -> None:
    live.say("nod", 0, seconds=2.0)
    texts = [(live.next_chunk().labels[0].text, live.frame) for _ in range(4)]
    assert texts[:2] == [("nod", WHOLE), ("nod", 60)]
    assert texts[2][0] == "stand idle"


def test_gait_goes_on_and_a_gesture_ends_by_itself(live: LiveGenerator) -> None:
    live.say("walk forward", 0)
    assert {live.next_chunk().labels[0].text for _ in range(8)} == {"walk forward"}
    at = live.frame
    live.say("nod")
    assert live.next_chunk().labels[0].text == "nod"
    assert live.frame == at + round(FPS)  # the fixture's usual length is 1 s
    assert live.next_chunk().labels[0].text == "stand idle"


def test_unknown_words_change_nothing_and_name_the_nearest(path: Path) -> None:
    live, other = LiveGenerator(path), LiveGenerator(path)
    found = live.say("quarterly tax return of a limited company", 10)
    assert not found.known
    assert found.nearest[0] in ("idle", "wave", "walk", "nod")
    assert np.array_equal(drawn(live, 80)[1], drawn(other, 80)[1])


def test_prompts_every_other_frame_are_all_heard_in_bounded_memory(live: LiveGenerator) -> None:
    live.steer(Steer(speed=0.5))
    for i in range(150):
        live.say("nod" if i % 2 else "walk forward", 2 * i)
        live.say("wave with the right hand", 2 * i)  # the later of two takes the place of the first
        live.next_chunk()
        live.steer(Steer(speed=0.1), 2 * i + 2)
        live.say("walk forward", 2 * i + 2)
        assert live.frame <= 2 * i + WHOLE
    kept = len(live._states), len(live._prompts), len(live._turns)
    assert max(kept) <= PAST_S * FPS + 2


@pytest.mark.parametrize(
    ("text", "message"), [("wave " * 1000, "4999 characters; at most 1000"), ("  ", "the text is empty")]
)
def test_bad_prompts_are_refused_in_a_line(live: LiveGenerator, text: str, message: str) -> None:
    with pytest.raises(PromptError, match=message) as error:
        live.say(text)
    assert "\n" not in str(error.value)


def test_frames_long_gone_cannot_change(live: LiveGenerator) -> None:
    drawn(live, 400)
    with pytest.raises(PromptError, match="frame 3 is gone; the earliest that can still change is"):
        live.say("nod", 3)
    with pytest.raises(PromptError, match="frame 3 is gone"):
        live.idle(3)


def test_steering_out_of_range_is_refused(live: LiveGenerator) -> None:
    area = Area((-2.0, -2.0), (2.0, 2.0))
    with pytest.raises(PromptError, match=r"leaves the floor at \(1, 3\) m; it is allowed within x -2…2 m, y -2…2 m"):
        Steer(path=((0.0, 0.0), (1.0, 3.0))).require_within(area)
    for bad, message in (
        ({"speed": 9.0}, "speed 9 m/s; between 0 and 4"),
        ({"speed": math.nan}, "finite"),
        ({"path": ((0.0, 1.0),), "heading": 0.0}, "a path or a heading"),
        ({"left_hand": (2.0, 0.0, 1.0)}, r"2\.03 m from between the shoulders"),
    ):
        with pytest.raises(PromptError, match=message):
            Steer(**bad)
    live.area = area
    with pytest.raises(PromptError, match="leaves the floor"):
        live.steer(Steer(path=((5.0, 0.0),)))


def test_signals_of_heading_turn_by_what_is_off(path: Path) -> None:
    model = load_weights(path)
    told = signals(model, Steer(heading=1.0, speed=0.5), 0.4, np.zeros(2), 0.0, 0)[SIZES.history :]
    rate = told[:, ROOT] * model.std[:3] + model.mean[:3]
    turned = rate[:, 0].sum() / FPS
    assert turned == pytest.approx(0.6 * (1 - math.exp(-CHUNK / FPS / 0.7)), abs=0.01)
    assert rate[-1, 1] == pytest.approx(0.5, abs=0.01)
    assert (told[:, ROOT_GIVEN] == 1).all()
    assert not signals(model, Steer(), 0.4, np.zeros(2), 0.0, 0).any()


def test_signals_of_a_path_lead_along_it_and_stop_at_its_end(path: Path) -> None:
    model = load_weights(path)

    def root(at: tuple[float, float], heading: float) -> np.ndarray:
        steer = Steer(path=((0.0, 0.0), (4.0, 0.0)))
        told = signals(model, steer, heading, np.array(at), 0.0, 0)[SIZES.history :]
        return told[:, ROOT] * model.std[:3] + model.mean[:3]

    assert root((1.0, 0.0), 0.0)[0] == pytest.approx([0, STROLL, 0], abs=1e-5)
    assert root((1.0, 0.3), 0.0)[0, 0] < 0  # left of it: to the right
    assert root((4.0, 0.05), 0.0)[0] == pytest.approx([0, 0, 0], abs=1e-5)


def test_signals_of_hands_come_once_they_had_time(path: Path) -> None:
    model = load_weights(path)
    told = signals(model, Steer(right_hand=(0.3, -0.2, 1.5)), 0.0, np.zeros(2), 0.0, 6)
    reached = told[:, HANDS_GIVEN[1]] > 0
    assert reached.sum() == CHUNK - round(REACH_S * FPS) + 6
    assert told[reached][:, HANDS[1]] == pytest.approx(np.tile([0.6, -0.4, 3.0], (reached.sum(), 1)))
    assert not told[:, HANDS_GIVEN[0]].any()


def test_what_is_steered_is_done_whatever_the_network_has_learnt(live: LiveGenerator) -> None:
    live.next_chunk()
    live.steer(Steer(heading=1.0, speed=0.5, right_hand=(0.3, -0.2, 1.3)))
    begun = live.state.heading
    motion = [live.next_chunk() for _ in range(3)][-1]
    seconds = 3 * WHOLE / FPS
    assert live.state.heading == pytest.approx(1.0 + (begun - 1.0) * math.exp(-seconds / 0.7), abs=0.02)
    wrist, root = motion.positions()[-1, [WRISTS[1], 0]]
    from_root = wrist - [*root[:2], 0.0]
    turn = live.state.heading
    ahead = from_root[:2] @ np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    assert [*ahead, from_root[2]] == pytest.approx([0.3, -0.2, 1.3], abs=0.02)


def test_way_off_the_floor_turns_back(live: LiveGenerator) -> None:
    live.next_chunk()
    state = live._states[-1]
    live.area = Area((-1.0, -1.0), (1.0, 1.0))
    live._states[-1] = replace(state, place=np.array([0.0, 3.0]))
    assert live._kept_inside(Steer()).heading == pytest.approx(-math.pi / 2)
    live._states[-1] = replace(state, place=np.zeros(2))
    assert live._kept_inside(Steer()).heading is None


def test_motion_that_is_handed_over_is_of_the_features(live: LiveGenerator) -> None:
    motion: Motion = live.next_chunk()
    found = motion_to_features(motion)
    assert found[:, HEIGHT] == pytest.approx(live._chunks[0].features[:, HEIGHT], abs=1e-5)
    assert motion.fps == FPS
    assert motion.source.seed == 0


def test_networks_are_not_taken_for_each_other(path: Path) -> None:
    with pytest.raises(WeightsError, match="needs weights with a history"):
        LiveGenerator(FOLDER / "mdm.safetensors")
    with pytest.raises(WeightsError, match="goes on from a history"):
        DiffusionGenerator(path)


def test_clips_are_as_long_as_asked_and_the_same_for_the_same_seed(path: Path) -> None:
    clips = LiveClips(path)
    one, again, other = (clips.generate("nod", seconds=3.0, seed=seed) for seed in (1, 1, 2))
    assert len(one) == 90
    assert np.array_equal(one.joint_quat, again.joint_quat)
    assert not np.allclose(one.joint_quat, other.joint_quat, atol=1e-3)
    assert [label.text for label in one.labels] == ["nod"]
    assert one.contacts is not None
    assert len(one.contacts) == 90
    assert len(clips.generate("nod")) == 30  # the fixture's usual length is 1 s
    strange = "quarterly tax return of a limited company"
    assert not clips.familiarity(strange).known
    assert clips.generate(strange, seconds=1.0).labels[0].text == strange
    guided = clips.generate("nod", seconds=3.0, seed=1, guidance=5.0)
    assert not np.allclose(guided.joint_quat, one.joint_quat, atol=1e-3)


def test_chunk_begins_where_the_past_leads_and_ends_as_drawn() -> None:
    rng = np.random.default_rng(0)
    past, drawn = rng.standard_normal((4, 140)), 1.0 + rng.standard_normal((30, 140))
    made = handed_over(past, drawn)
    rate = (past[-1] - past[-2] + drawn[1] - drawn[0]) / 2
    assert made[0, :136] == pytest.approx((past[-1] + rate)[:136])
    assert np.array_equal(made[HAND_OVER:], drawn[HAND_OVER:])
    assert np.array_equal(made[:, 136:], drawn[:, 136:])
    assert np.array_equal(handed_over(past[:1], drawn), drawn)
    line = np.arange(34.0)[:, None] * np.ones(140)
    assert handed_over(line[:4], line[4:]) == pytest.approx(line[4:])  # what goes on evenly stays as it is
