"""The networks of phases: an analytic motion through the auto-encoder; numpy against torch; what is not heard."""

import numpy as np
import pytest
import torch

from motiongen.diffusion.configs import DiffusionPhaseConfig, PhaseAutoencoderConfig
from motiongen.diffusion.said import Said
from motiongen.nn import Tensors
from motiongen.phase.autoencoder import PhaseAutoencoder, margin
from motiongen.phase.denoiser import PhaseDenoiser
from motiongen.phase.phase_run import Start, decode, denoise, encode
from motiongen.phase.phases import Course, Timing, course, readings, signals

SMALL = PhaseAutoencoderConfig(features=5, highest=6, phases=32, narrow=8, hidden=16, width=12)
EDGE = margin(SMALL.kernel)
RNG = np.random.default_rng(1)


def random_timing(count: int) -> Timing:
    return Timing(*(RNG.integers(low, low + 20, count) for low in (0, 40, 0)))


def tensors_of(model: torch.nn.Module) -> Tensors:
    return {name: tensor.detach().numpy() for name, tensor in model.state_dict().items()}


def in_torch(at: Course) -> Course:
    return Course(*(torch.from_numpy(y) for y in (at.k, at.head, at.tail)))


@pytest.fixture
def autoencoder() -> PhaseAutoencoder:
    torch.manual_seed(0)
    model = PhaseAutoencoder(SMALL).eval()
    for p in model.parameters():
        torch.nn.init.normal_(p, std=0.2)
    return model


@torch.inference_mode()
def test_an_analytic_periodic_motion_is_reproduced_to_a_thousandth() -> None:
    """Fitted: the decoder's straight map alone, by least squares, on 12 motions of 61 frames, each a sum of sines of
    the layout's frequencies; another motion of that kind is then encoded and decoded, in the period that was encoded
    and long after. The layers beside the straight ways are as they begin; the encoder's convolution sees one frame."""
    torch.manual_seed(0)
    model = PhaseAutoencoder(SMALL).double().eval()
    model.encoder.narrow.weight *= torch.arange(SMALL.kernel) == SMALL.kernel // 2
    amplitude, shift = RNG.normal(size=(13, 1, 5, 4)), RNG.uniform(size=(13, 1, 5, 4))
    when = Timing(*(np.full(13, n) for n in (0, 60, 0)))

    def motion(frame: np.ndarray) -> np.ndarray:
        angle = 2 * np.pi * (frame[:, None, None] / 60 * np.array([1, 2, 3, 6]) - shift)
        return (amplitude * np.sin(angle)).sum(-1)

    def signal(start: int, stop: int) -> np.ndarray:
        return signals(code, in_torch(course(when, np.arange(start, stop))), model.layout).numpy()

    read, x = torch.from_numpy(readings(when, 61, SMALL.highest)).double(), motion(np.arange(61))
    code = model.encoder(torch.from_numpy(x), read, torch.zeros(13, 2).double())
    known = np.pad(signal(0, 61)[:12], ((0, 0), (0, 0), (0, 1)), constant_values=1.0)
    fitted = np.linalg.lstsq(known.reshape(12 * 61, -1), x[:12].reshape(12 * 61, -1), rcond=None)[0]
    model.decoder.straight.weight.copy_(torch.from_numpy(fitted[:-1].T))
    model.decoder.straight.bias.copy_(torch.from_numpy(fitted[-1]))
    for start, stop in ((0, 61), (200, 300)):
        made = model.decoder(torch.from_numpy(signal(start - EDGE, stop + EDGE))).numpy()
        assert np.abs(made - motion(np.arange(start, stop)))[12].max() < 1e-3


@torch.inference_mode()
def test_numpy_encodes_and_decodes_as_torch_does(autoencoder: PhaseAutoencoder) -> None:
    when, w = random_timing(4), tensors_of(autoencoder)
    length = int(when.frames.max())
    x = RNG.normal(size=(4, length, 5)).astype(np.float32)
    read, at = readings(when, length, SMALL.highest), course(when, np.arange(-EDGE, length + EDGE))
    guess, code = autoencoder(*(torch.from_numpy(y) for y in (x, read, when.shares)), in_torch(at))
    mine = encode(w, autoencoder.layout, x, when)
    assert np.abs(mine - code.numpy()).max() < 1e-4
    signal = signals(code.numpy(), at, autoencoder.layout)
    assert np.abs(decode(w, signal) - guess.numpy()).max() < 1e-3


@torch.inference_mode()
def test_what_follows_a_motion_changes_nothing(autoencoder: PhaseAutoencoder) -> None:
    when, w = random_timing(1), tensors_of(autoencoder)
    x = RNG.normal(size=(1, int(when.frames[0]), 5)).astype(np.float32)
    longer = np.concatenate([x, np.repeat(x[:, -1:], 9, axis=1)], axis=1)
    code = encode(w, autoencoder.layout, x, when)
    assert np.abs(encode(w, autoencoder.layout, longer, when) - code).max() < 1e-5


@torch.inference_mode()
def test_a_motion_that_begins_later_has_other_shifts_only(autoencoder: PhaseAutoencoder) -> None:
    """The straight way is Fourier's: by a quarter of the segment, A stays and S of frequency F moves by F / 4."""
    for layer in autoencoder.encoder.layers:
        for p in layer.parameters():
            torch.nn.init.zeros_(p)
    when, layout = Timing(*(np.array([n]) for n in (0, 40, 0))), autoencoder.layout
    loop = np.tile(RNG.normal(size=(1, 40, 5)).astype(np.float32), (1, 5, 1))
    w = tensors_of(autoencoder)
    w["encoder.narrow.weight"] = w["encoder.narrow.weight"] * (np.arange(5) == 2)  # no frames of the neighbourhood
    here, there = (
        encode(w, layout, loop[:, a : a + 41], when)[0, : 3 * layout.phases].reshape(-1, 3, layout.group)
        for a in (0, 10)
    )
    turn = np.exp(2j * np.pi * np.array(layout.frequencies) / 4)[:, None]
    moved = (here[:, 0] + 1j * here[:, 1]) * np.conj(turn)
    assert np.abs(there[:, 0] + 1j * there[:, 1] - moved).max() < 1e-4
    assert np.abs(there[:, 2] - here[:, 2]).max() < 1e-4


@pytest.fixture
def denoiser() -> PhaseDenoiser:
    torch.manual_seed(0)
    sizes = DiffusionPhaseConfig(features=5, width=32, layers=2, heads=2, feed_forward=48, text=16)
    model = PhaseDenoiser(sizes, SMALL).eval()
    for p in model.parameters():
        torch.nn.init.normal_(p, std=0.1)
    return model


def asked(model: PhaseDenoiser) -> dict[str, torch.Tensor]:
    g = torch.Generator().manual_seed(2)
    return {
        "x": torch.randn(3, len(model.center), generator=g),
        "t": torch.full((3,), 0.4),
        "words": torch.randn(3, 6, 16, generator=g),
        "word_mask": torch.arange(6) < torch.tensor([[6], [3], [1]]),
        "sentence": torch.randn(3, 16, generator=g),
        "keep": torch.tensor([True, False, True]),
        "pose": torch.randn(3, 5, generator=g),
        "keep_pose": torch.tensor([True, True, False]),
        "frames": torch.tensor([90, 61, 240]),
    }


@torch.inference_mode()
def test_numpy_denoises_as_torch_does(denoiser: PhaseDenoiser) -> None:
    given = asked(denoiser)
    y = {name: tensor.numpy() for name, tensor in given.items()}
    told = Said(y["words"], y["word_mask"], y["sentence"], y["keep"])
    start = Start(y["pose"], y["keep_pose"], y["frames"])
    layout = denoiser.autoencoder.layout
    mine = denoise(tensors_of(denoiser), layout, 2, y["x"], 0.4, told, start)
    assert np.abs(mine - denoiser(**given).numpy()).max() < 1e-4


@torch.inference_mode()
def test_what_is_dropped_is_not_heard_and_what_is_not_is(denoiser: PhaseDenoiser) -> None:
    given = asked(denoiser)
    other = given | {name: -given[name] for name in ("words", "sentence", "pose")}
    off = (denoiser(**given) - denoiser(**other)).abs().amax(1)
    assert (off > 1e-5).all()
    nothing = {name: torch.zeros(3, dtype=torch.bool) for name in ("keep", "keep_pose")}
    assert torch.equal(denoiser(**(given | nothing)), denoiser(**(other | nothing)))
    longer = denoiser(**(given | {"frames": given["frames"] + 1}))
    assert ((longer - denoiser(**given)).abs().amax(1) > 1e-5).all()
