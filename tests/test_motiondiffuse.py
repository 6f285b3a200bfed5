"""MotionDiffuse's network against Eq. 8 and 9 written out, against itself in numpy; what padding may not change."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from attention import written_out
from network_inputs import in_numpy, inputs

from motiongen.diffusion import motiondiffuse, motiondiffuse_run
from motiongen.diffusion.configs import MotionDiffuseConfig
from motiongen.diffusion.motiondiffuse import MotionDiffuse, Stylize, noise_loss, noise_weight
from motiongen.diffusion.schedule import LINEAR

SMALL = MotionDiffuseConfig(
    features=10,
    patch=6,
    width=32,
    layers=2,
    heads=2,
    feed_forward=48,
    text=16,
    text_width=24,
    text_layers=2,
    text_feed_forward=20,
    actions=3,
)


@pytest.fixture(params=[6, 1])
def model(request: pytest.FixtureRequest) -> MotionDiffuse:
    torch.manual_seed(0)
    model = MotionDiffuse(replace(SMALL, patch=request.param)).eval()
    for p in model.parameters():
        torch.nn.init.normal_(p, std=0.2)
    return model


@pytest.mark.parametrize("source", [5, 8])  # self-attention, and to a text of another length
def test_efficient_attention_is_eq_8(source: int) -> None:
    rng = np.random.default_rng(source)
    q = rng.standard_normal((2, 5, 6)) * 3
    k, v = rng.standard_normal((2, 2, source, 6)) * 3
    mask = rng.random((2, source)) < 0.7
    mask[:, 0] = True
    expected = written_out(q, k, v, mask, 2)
    by_torch = motiondiffuse.efficient_attention(*map(torch.from_numpy, (q, k, v, mask)), 2).numpy()
    assert np.abs(by_torch - expected).max() < 1e-10
    assert np.abs(motiondiffuse_run.efficient_attention(q, k, v, mask, 2) - expected).max() < 1e-10


@torch.inference_mode()
def test_a_style_is_eq_9() -> None:
    torch.manual_seed(0)
    block, y, e = Stylize(8, 4).double(), torch.randn(2, 3, 8).double(), torch.randn(2, 4).double()
    assert (block(y, e) == 0).all()  # a new block adds nothing
    for p in block.parameters():
        torch.nn.init.normal_(p)
    w = {name: p.numpy() for name, p in block.named_parameters()}
    hidden = e.numpy() @ w["phi.weight"].T + w["phi.bias"]
    hidden = hidden / (1 + np.exp(-hidden))
    scale, shift = (hidden @ w[f"{name}.weight"].T + w[f"{name}.bias"] for name in ("scale", "shift"))
    level = (y - y.mean(-1, keepdim=True)) / (y.var(-1, correction=0, keepdim=True) + 1e-5).sqrt()
    normal = level.numpy() * w["norm.weight"] + w["norm.bias"]
    assert np.abs(block(y, e).numpy() - (normal * scale[:, None] + shift[:, None])).max() < 1e-10


@torch.inference_mode()
def test_padding_changes_nothing(model: MotionDiffuse) -> None:
    given = inputs(10)
    out = model(**given)
    longer = dict(given, x=torch.cat([given["x"], torch.randn(2, 12, 10)], 1))
    longer["frames"] = torch.cat([given["frames"], torch.zeros(2, 12, dtype=torch.bool)], 1)
    longer["words"] = torch.cat([given["words"], torch.randn(2, 3, 16)], 1)
    longer["word_mask"] = torch.cat([given["word_mask"], torch.zeros(2, 3, dtype=torch.bool)], 1)
    assert torch.allclose(model(**longer)[:, :24], out, atol=1e-5)


@torch.inference_mode()
def test_dropped_text_is_not_heard(model: MotionDiffuse) -> None:
    given = inputs(10)
    other = dict(given, words=torch.cat([given["words"] * 2] * 2, 1), sentence=-given["sentence"])
    other["word_mask"] = torch.ones(2, 10, dtype=torch.bool)
    dropped = {"keep": torch.tensor([False, False])}
    assert torch.allclose(model(**(given | dropped)), model(**(other | dropped)), atol=1e-5)
    for part in ("words", "sentence"):
        assert not torch.allclose(model(**given), model(**dict(given, **{part: -given[part]})), atol=1e-3)


@torch.inference_mode()
def test_an_action_stands_for_the_text(model: MotionDiffuse) -> None:
    given = inputs(10)
    other = dict(given, words=given["words"] * 2, sentence=-given["sentence"])
    by_action = {"action": torch.tensor([2, 2])}
    assert torch.allclose(model(**(given | by_action)), model(**(other | by_action)), atol=1e-5)
    assert not torch.allclose(model(**(given | by_action)), model(**given, action=torch.tensor([1, 1])), atol=1e-3)
    assert torch.equal(model(**given, action=torch.tensor([-1, -1])), model(**given))


@torch.inference_mode()
def test_it_is_told_how_much_is_left(model: MotionDiffuse) -> None:
    for p in model.blocks.parameters():
        torch.nn.init.zeros_(p)  # nothing is passed between frames any more
    given = inputs(10)
    shorter = dict(given, frames=given["frames"].clone())
    shorter["frames"][:, 18:] = False
    assert not torch.allclose(model(**given)[:, :18], model(**shorter)[:, :18], atol=1e-3)
    torch.nn.init.zeros_(model.to_end.weight)
    assert torch.equal(model(**given), model(**shorter))


@torch.inference_mode()
def test_numpy_runs_the_same_network(model: MotionDiffuse) -> None:
    given = inputs(10) | {"keep": torch.tensor([True, False]), "action": torch.tensor([1, -1])}
    given["frames"][1, 12:] = False
    given["word_mask"][0, 3:] = False
    tensors = {k: v.numpy() for k, v in model.state_dict().items()}
    for t in (1.0, 0.4, 0.0501, 0.001, 0.0):
        x, frames, said = in_numpy(given)
        out = motiondiffuse_run.denoise(tensors, asdict(model.config), x, t, frames, said)
        expected = model(**(given | {"t": torch.tensor([t, t])})).numpy()
        assert np.abs(out - expected).max() < 2e-5 * np.abs(expected).max()


@torch.inference_mode()
def test_a_token_of_several_frames_writes_clean_features_and_of_one_the_noise(model: MotionDiffuse) -> None:
    written: list[torch.Tensor] = []
    model.write.register_forward_hook(lambda _, __, out: written.append(out.view(2, 24, 10)))
    for t in (1.0, 0.7123, 0.2):
        given = inputs(10) | {"t": torch.tensor([t, t])}
        alpha, sigma = LINEAR.signal_and_noise(t)
        noise = model(**given)
        clean = (given["x"] - sigma * noise) / alpha  # as `from_noise` of the sampler
        if model.config.patch == 1:
            assert torch.equal(noise, written[-1])
        else:
            assert (clean - written[-1]).abs().max() < 1e-3  # though α is 1/158 at t = 1


def test_the_loss_is_the_error_of_the_noise_and_balanced_that_of_the_clean_features() -> None:
    torch.manual_seed(0)
    t = np.array([1.0, 0.9, 0.35, 0.1, 0.01])
    alpha, sigma = (torch.from_numpy(y) for y in LINEAR.levels(t))
    noise, off = torch.randn(2, 5, 4, 10).double()
    guess = noise - (alpha / sigma)[:, None, None] * off  # of a network that is wrong by `off` in x_0
    frames = torch.ones(5, 4, dtype=torch.bool)
    frames[2, 1:] = False
    error = (guess - noise)[frames].square().mean()
    assert noise_loss(guess, noise, frames, frames, torch.ones(5)).item() == pytest.approx(error.item())
    counts = np.clip((alpha / sigma).numpy() ** 2, 1, 5)[:, None, None] * frames.numpy()[..., None]
    balanced = (counts * off.numpy() ** 2).sum() / frames.sum() / 10
    weighed = noise_loss(guess, noise, frames, frames, noise_weight(alpha, sigma))
    assert weighed.item() == pytest.approx(balanced.item())


def test_the_configs_in_the_tree_have_the_size_that_is_said() -> None:
    def count(config: MotionDiffuseConfig) -> int:
        return sum(p.numel() for p in MotionDiffuse(config).parameters())

    assert count(MotionDiffuseConfig(actions=120)) < 4.4e6
