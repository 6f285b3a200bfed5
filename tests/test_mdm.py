"""The denoiser and its losses: what padding and dropped text may not change, and kinematics against the motion type."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from motions import skeleton, walk
from network_inputs import in_numpy, inputs

from motiongen.diffusion.configs import LossWeights, MdmConfig
from motiongen.diffusion.losses import joint_positions, loss, world_velocity
from motiongen.diffusion.mdm import Mdm
from motiongen.diffusion.mdm_run import denoise
from motiongen.features import motion_to_features
from motiongen.rotation import quat_conj, quat_rotate, yaw_of_quat, yaw_quat

SMALL = MdmConfig(features=140, width=32, layers=2, heads=2, feed_forward=48, text=16, actions=3)


@pytest.fixture(params=["encoder", "decoder"])
def model(request: pytest.FixtureRequest) -> Mdm:
    torch.manual_seed(0)
    model = Mdm(replace(SMALL, form=request.param)).eval()
    for p in model.parameters():
        torch.nn.init.normal_(p, std=0.1)
    return model


@torch.inference_mode()
def test_padding_changes_nothing(model: Mdm) -> None:
    given = inputs(140)
    out = model(**given)
    longer = dict(given, x=torch.cat([given["x"], torch.randn(2, 12, 140)], 1))
    longer["frames"] = torch.cat([given["frames"], torch.zeros(2, 12, dtype=torch.bool)], 1)
    longer["words"] = torch.cat([given["words"], torch.randn(2, 3, 16)], 1)
    longer["word_mask"] = torch.cat([given["word_mask"], torch.zeros(2, 3, dtype=torch.bool)], 1)
    assert torch.allclose(model(**longer)[:, :24], out, atol=1e-5)


@torch.inference_mode()
def test_dropped_text_is_not_heard(model: Mdm) -> None:
    given = inputs(140)
    other = dict(given, words=given["words"] * 2, sentence=-given["sentence"])
    dropped = {"keep": torch.tensor([False, False])}
    assert torch.allclose(model(**(given | dropped)), model(**(other | dropped)), atol=1e-6)
    assert not torch.allclose(model(**given), model(**other), atol=1e-5)


@torch.inference_mode()
def test_an_action_stands_for_the_text(model: Mdm) -> None:
    given = inputs(140)
    other = dict(given, words=given["words"] * 2, sentence=-given["sentence"])
    by_action = {"action": torch.tensor([2, 2])}
    assert torch.allclose(model(**(given | by_action)), model(**(other | by_action)), atol=1e-6)
    assert not torch.allclose(model(**(given | by_action)), model(**given, action=torch.tensor([1, 1])), atol=1e-5)
    assert torch.equal(model(**given, action=torch.tensor([-1, -1])), model(**given))


@torch.inference_mode()
def test_it_is_told_how_much_is_left(model: Mdm) -> None:
    given = inputs(140)
    shorter = dict(given, frames=given["frames"].clone())
    shorter["frames"][:, 18:] = False
    with_place = (model(**given) - model(**shorter))[:, :6].abs().max()
    torch.nn.init.zeros_(model.to_end.weight)
    assert with_place > (model(**given) - model(**shorter))[:, :6].abs().max()


@torch.inference_mode()
def test_numpy_runs_the_same_network(model: Mdm) -> None:
    given = inputs(140) | {"t": torch.tensor([0.4, 0.4]), "keep": torch.tensor([True, False])}
    given["action"] = torch.tensor([1, -1])
    given["frames"][1, 12:] = False
    given["word_mask"][0, 3:] = False
    x, frames, said = in_numpy(given)
    tensors = {k: v.numpy() for k, v in model.state_dict().items()}
    out = denoise(tensors, {"patch": SMALL.patch, "heads": SMALL.heads}, x, 0.4, frames, said)
    assert np.abs(out - model(**given).numpy()).max() < 2e-5


def walked() -> tuple[torch.Tensor, torch.Tensor]:
    motion = walk(seconds=2.0)
    features = torch.from_numpy(motion_to_features(motion))[None]
    return features, torch.tensor(motion.skeleton.offsets, dtype=torch.float32)


def test_positions_are_the_motions_own() -> None:
    features, offsets = walked()
    motion = walk(seconds=2.0)
    level = quat_conj(yaw_quat(yaw_of_quat(motion.joint_quat[:, 0])))
    centred = motion.positions() - motion.root_pos[:, None] * [1, 1, 0]
    expected = quat_rotate(level[:, None], centred)
    assert np.abs(joint_positions(features, offsets)[0].numpy() - expected).max() < 1e-4


def test_velocity_is_the_finite_difference_of_world_positions() -> None:
    features, offsets = walked()
    motion = walk(seconds=2.0)
    expected = np.linalg.norm(np.diff(motion.positions(), axis=0), axis=-1) * motion.fps
    speed = world_velocity(features, joint_positions(features, offsets)).norm(dim=-1)[0].numpy()
    assert np.abs(speed - expected).max() < 5e-3


def test_a_perfect_guess_costs_only_the_slip_of_real_feet() -> None:
    features, offsets = walked()
    frames = torch.ones(features.shape[:2], dtype=torch.bool)
    mean, std, one = torch.zeros(140), torch.ones(140), torch.ones(1)
    terms = loss(features, features, frames, frames, one, mean, std, offsets, LossWeights())
    assert terms["feature"] == terms["position"] == terms["velocity"] == 0
    off = loss(features + 0.1, features, frames, frames, one, mean, std, offsets, LossWeights())
    assert off["feature"].item() == pytest.approx(0.01, rel=1e-4)
    assert off["total"] > terms["total"]


def test_a_clip_counts_by_its_weight() -> None:
    features, offsets = walked()
    two, frames = torch.cat([features, features]), torch.ones(2, features.shape[1], dtype=torch.bool)
    wrong = two + torch.tensor([0.1, 0.3])[:, None, None]
    mean, std = torch.zeros(140), torch.ones(140)
    terms = loss(wrong, two, frames, frames, torch.tensor([2.0, 0.5]), mean, std, offsets, LossWeights())
    assert terms["feature"].item() == pytest.approx((2 * 0.01 + 0.5 * 0.09) / 2, rel=1e-4)


def test_skeleton_of_the_tests_has_the_models_joints() -> None:
    assert len(skeleton().names) == 22
