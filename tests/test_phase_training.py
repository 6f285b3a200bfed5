"""Both stages of DiffusionPhase on a small data set of gestures: resumed, refused, exported, and motions drawn."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, safe_open

from motiongen.data.build import build
from motiongen.data.dataset import Dataset
from motiongen.diffusion import lengths
from motiongen.diffusion.configs import DiffusionPhaseConfig, PhaseAutoencoderConfig, TrainConfig, require_sound
from motiongen.diffusion.export import export
from motiongen.diffusion.named_configs import CONFIGS, named
from motiongen.diffusion.run_folder import RunError
from motiongen.diffusion.train import Log, Watch, train
from motiongen.diffusion.weights import WeightsError
from motiongen.generator import PromptError, load_generator
from motiongen.motion import SMPL_JOINTS
from motiongen.phase.codec import Codec
from motiongen.phase.first_stage import read_first_stage
from motiongen.phase.generator import PhaseGenerator

SMALL = PhaseAutoencoderConfig(highest=6, phases=16, narrow=8, hidden=16, width=16)
SHORT = {"steps": 4, "batch": 3, "save_every": 2, "log_every": 1}


def second(first: Path) -> TrainConfig:
    sizes = DiffusionPhaseConfig(str(first), width=32, layers=1, heads=2, feed_forward=32, codes=12, decoded=2)
    return replace(named("diffusionphase"), model=sizes, **SHORT)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return build(["gestures:24"], tmp_path_factory.mktemp("data") / "set")[0]


@pytest.fixture(autouse=True, scope="module")
def short_fits() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lengths, "STEPS", 50)  # that lengths are learnt is tested elsewhere
        yield


@pytest.fixture(scope="module")
def first(data: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("first")
    train(replace(named("phase-autoencoder"), model=SMALL, **SHORT), data, folder)
    return folder


@pytest.fixture(scope="module")
def weights(data: Dataset, first: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("second")
    train(second(first), data, folder)
    export(data, folder, folder / "phases.safetensors")
    return folder / "phases.safetensors"


def stopped_by(log: Log) -> None:
    if log.step == 3:
        raise KeyboardInterrupt


@pytest.mark.parametrize("stage", ["first", "second"])
def test_resumed_training_is_the_same_as_unbroken(data: Dataset, first: Path, tmp_path: Path, stage: str) -> None:
    config = replace(named("phase-autoencoder"), model=SMALL, **SHORT) if stage == "first" else second(first)
    train(config, data, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(config, data, tmp_path / "parts", Watch(logged=stopped_by))
    train(config, data, tmp_path / "parts")
    whole, parts = (load_file(tmp_path / run / "checkpoint.safetensors") for run in ("whole", "parts"))
    assert int(parts["step"]) == 4
    assert all(np.array_equal(whole[k], parts[k]) for k in whole)


def test_the_second_stage_takes_the_first_over_as_it_is(first: Path, weights: Path) -> None:
    trained = load_file(weights.parent / "checkpoint.safetensors")
    for name, tensor in read_first_stage(first).tensors.items():
        assert np.array_equal(trained[f"model.autoencoder.{name}"], tensor)
        assert np.array_equal(trained[f"average.autoencoder.{name}"], tensor)
    codes = load_file(weights.parent / "codes.safetensors")["codes"].astype(np.float32)
    assert np.allclose(trained["model.center"], codes.mean(0), atol=1e-3)
    assert not any("autoencoder" in name for name in trained if name.startswith("optimizer"))


def test_what_cannot_be_is_refused(data: Dataset, first: Path, weights: Path, tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"a run of diffusionphase, not of phase-autoencoder; train that first"):
        train(second(weights.parent), data, tmp_path / "a")
    with pytest.raises(RunError, match="no training run"):
        train(second(tmp_path), data, tmp_path / "b")
    with pytest.raises(ValueError, match="102 phases; they must be a multiple of 4"):
        train(replace(named("phase-autoencoder"), model=replace(SMALL, phases=102), **SHORT), data, tmp_path / "c")
    for name, value in (("prediction", "noise"), ("by_action", 0.1), ("balanced", True), ("compile", True)):
        with pytest.raises(ValueError, match=f"{name} must be .* for phase-autoencoder, not {value}"):
            require_sound(replace(CONFIGS["phase-autoencoder"], **{name: value}))
    broken = tmp_path / "d"
    broken.mkdir()
    (broken / "codes.safetensors").write_bytes(b"nothing")
    with pytest.raises(RunError, match=r"codes\.safetensors: damaged; remove it"):
        train(second(first), data, broken)


def test_weights_carry_what_their_run_was_and_no_paths(weights: Path) -> None:
    with safe_open(weights, "np") as file:
        metadata = file.metadata()
    assert metadata["network"] == "diffusionphase"
    assert '"highest": 6' in metadata["sizes"]
    assert str(weights.parent.parent) not in str(metadata)


@pytest.fixture(scope="module")
def generator(weights: Path) -> PhaseGenerator:
    made = load_generator(str(weights))
    assert isinstance(made, PhaseGenerator)
    return made


def test_a_generator_without_weights_says_so_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match=r"none\.safetensors: no such weights file$"):
        load_generator(str(tmp_path / "none.safetensors"))


@pytest.mark.parametrize("seconds", [1.0, 2.5, 30.0, None])
def test_motions_last_as_long_as_is_asked_for(generator: PhaseGenerator, seconds: float | None) -> None:
    motion = generator.generate("wave with the right hand", seconds=seconds, seed=3)
    assert motion.skeleton.names == SMPL_JOINTS
    assert motion.labels[0].text == "wave with the right hand"
    assert seconds is None or len(motion) == round(30 * seconds)


def test_the_same_is_drawn_alone_and_in_a_batch(generator: PhaseGenerator) -> None:
    texts = ["nod", "clap three times"]
    both = generator.generate_batch(texts, seconds=2.0, seed=5)
    alone = generator.generate(texts[1], seconds=2.0, seed=6)
    assert np.allclose(both[1].positions(), alone.positions(), atol=1e-4)
    assert not np.allclose(both[1].root_pos, generator.generate(texts[1], seconds=2.0, seed=7).root_pos, atol=1e-4)


def test_guidance_and_start_pose_are_heard(generator: PhaseGenerator) -> None:
    (plain,) = generator.phrases(["nod"], seconds=2.0, seeds=[0])
    (guided,) = generator.phrases(["nod"], seconds=2.0, seeds=[0], guidance=4.0)
    (posed,) = generator.phrases(["nod"], seconds=2.0, seeds=[0], poses=np.ones((1, 140), np.float32))
    assert not np.allclose(plain.code, guided.code, atol=1e-5)
    assert not np.allclose(plain.code, posed.code, atol=1e-5)
    with pytest.raises(ValueError, match="guidance must be a number, not nan"):
        generator.generate("nod", guidance=float("nan"))


def test_texts_follow_one_another(generator: PhaseGenerator) -> None:
    motion = generator.generate_sequence(["nod", "wave", "clap"], seconds=2.0, seed=1)
    assert [label.text for label in motion.labels] == ["nod", "wave", "clap"]
    assert [label.end_s for label in motion.labels][:-1] == [label.start_s for label in motion.labels][1:]
    assert motion.labels[-1].end_s == pytest.approx(motion.duration)
    with pytest.raises(PromptError, match="the text is empty"):
        generator.generate_sequence(["nod", " "], seconds=2.0)


def test_a_denser_motion_is_the_same_between(generator: PhaseGenerator) -> None:
    phrases = generator.phrases(["nod"], seconds=2.0, seeds=[0])
    plain, dense = (generator.motion(phrases, ["nod"], seed=0, dense=n) for n in (1, 4))
    assert (dense.fps, len(dense)) == (120.0, 4 * (len(plain) - 1) + 1)
    x = generator.codec.features(phrases, 4)
    assert np.allclose(x[0], generator.codec.features(phrases)[0], atol=1e-5)
    assert np.allclose(dense.joint_quat[::4, 1:], plain.joint_quat[:, 1:], atol=1e-3)
    with pytest.raises(ValueError, match="dense must be 1 or more, not 0"):
        generator.codec.features(phrases, 0)


def test_a_motion_is_encoded_as_it_was_in_training(generator: PhaseGenerator, data: Dataset, first: Path) -> None:
    found = read_first_stage(first)
    codec = Codec(found.tensors, found.layout, *vars(found.run.scale).values())
    clip = data.motion(0)
    phrase = codec.encoded(clip)
    assert phrase.frames == len(clip)
    assert np.allclose(generator.codec.encoded(clip).code, phrase.code, atol=0.05)  # weights in half precision
