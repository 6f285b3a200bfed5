"""Training on a small data set of gestures: exact resuming, processes, what is refused, imports, a file to run."""

import json
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from motiongen.data.build import build
from motiongen.data.dataset import Dataset
from motiongen.diffusion import lengths
from motiongen.diffusion.batches import Batch, Batches
from motiongen.diffusion.configs import LossWeights, MdmConfig, MotionDiffuseConfig, TrainConfig, require_sound
from motiongen.diffusion.export import export
from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.diffusion.named_configs import CONFIGS, named
from motiongen.diffusion.train import Log, Watch, train
from motiongen.motion import Motion
from rigcast.__main__ import main
from rigcast.train import train as verb

ROOT = Path(__file__).parent.parent
SIZES = {
    "mdm": MdmConfig(width=32, layers=1, heads=2, feed_forward=32),
    "motiondiffuse": MotionDiffuseConfig(
        width=32, layers=1, heads=2, feed_forward=32, text_width=16, text_layers=1, text_feed_forward=16
    ),
}
SMALL = {name: replace(CONFIGS[name], model=sizes, steps=4, batch=3, save_every=2) for name, sizes in SIZES.items()}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return build(["gestures:24"], tmp_path_factory.mktemp("data") / "set")[0]


@pytest.fixture(autouse=True)
def short_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lengths, "STEPS", 50)  # that lengths are learnt is tested elsewhere


@pytest.fixture(scope="module")
def run(data: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run, not to be changed."""
    folder = tmp_path_factory.mktemp("run")
    train(SMALL["mdm"], data, folder)
    return folder


def stopped_by(log: Log) -> None:
    if log.step == 5:
        raise KeyboardInterrupt


@pytest.mark.parametrize("name", ["mdm", "motiondiffuse"])
def test_resumed_training_is_the_same_as_unbroken(data: Dataset, tmp_path: Path, name: str) -> None:
    config = replace(SMALL[name], steps=6, save_every=3, log_every=1)
    train(config, data, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(config, data, tmp_path / "parts", Watch(logged=stopped_by))
    assert int(load_file(tmp_path / "parts/checkpoint.safetensors")["step"]) == 3
    train(config, data, tmp_path / "parts")
    whole, parts = (load_file(tmp_path / run / "checkpoint.safetensors") for run in ("whole", "parts"))
    assert int(parts["step"]) == 6
    assert set(whole) == set(parts)
    assert all(np.array_equal(whole[k], parts[k]) for k in whole)


def test_what_is_no_number_stops_the_run(data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def draw(self: Batches, number: int, share: slice) -> Batch:
        batch = drawn(self, number, share)
        return replace(batch, x=batch.x * np.nan) if number == 3 else batch

    drawn = Batches.draw
    monkeypatch.setattr(Batches, "draw", draw)
    with pytest.raises(RuntimeError, match=r"the loss is nan.* at batch 3 .*; the checkpoint of step 2 is good"):
        train(SMALL["mdm"], data, tmp_path)
    kept = load_file(tmp_path / "checkpoint.safetensors")
    assert int(kept["step"]) == 2
    assert all(np.isfinite(tensor).all() for tensor in kept.values())


def test_logs_tell_the_mean_and_what_is_left(data: Dataset, tmp_path: Path) -> None:
    logs: list[Log] = []
    train(replace(SMALL["mdm"], log_every=1), data, tmp_path / "each", Watch(logged=logs.append))
    train(replace(SMALL["mdm"], log_every=4), data, tmp_path / "all", Watch(logged=logs.append))
    *each, last = logs
    assert [log.step for log in logs] == [1, 2, 3, 4, 4]
    assert last.terms == pytest.approx({k: np.mean([log.terms[k] for log in each]) for k in last.terms})
    assert each[1].left == pytest.approx(2 * each[1].pace)
    assert each[0].rate == pytest.approx(SMALL["mdm"].rate / SMALL["mdm"].warm_up)


def test_samples_are_drawn_on_the_way(data: Dataset, tmp_path: Path) -> None:
    drawn: dict[int, list[Motion]] = {}
    train(replace(SMALL["motiondiffuse"], show_every=2), data, tmp_path, Watch(drawn=drawn.__setitem__))
    assert set(drawn) == {2, 4}
    said = [[motion.labels[0].text for motion in motions] for motions in drawn.values()]
    assert said[0] == said[1]
    assert len(set(said[0])) == 4
    trained = {c: e.frames for i, e in enumerate(data.entries) if e.split == "train" for c in data.captions(i)}
    assert [len(motion) for motion in drawn[2]] == [trained[c] for c in said[0]]


def run_python(*args: str, **environment: str) -> None:
    done = subprocess.run(
        [sys.executable, *args], capture_output=True, text=True, cwd=ROOT, env=os.environ | environment
    )
    assert done.returncode == 0, done.stderr


def test_two_processes_learn_what_one_does(data: Dataset, tmp_path: Path) -> None:
    """By what the optimizer keeps of the gradients of one step, a tenth of each after clipping."""
    sizes = "--model.width 32 --model.layers 1 --model.heads 2 --model.feed-forward 32"
    verb = f"rigcast train --data {data.folder} --steps 1 --batch 5 --bf16 False --log-every 1 {sizes}".split()
    run_python("-m", *verb, "--out", str(tmp_path / "one"))
    torchrun = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", "-m"]
    run_python(*torchrun, *verb, "--out", str(tmp_path / "two"), OMP_NUM_THREADS="1")
    one, two = (load_file(tmp_path / name / "checkpoint.safetensors") for name in ("one", "two"))
    gradients = [name for name in one if name.endswith("exp_avg")]
    assert max(np.abs(one[name]).max() for name in gradients) > 1e-3
    assert all(np.abs(one[name] - two[name]).max() < 1e-6 for name in gradients)


def test_torch_numpy_and_safetensors_are_enough(data: Dataset, run: Path, tmp_path: Path) -> None:
    """On a machine that has nothing else, once the captions are encoded."""
    code = f"""
import sys
sys.modules |= dict.fromkeys(["msgspec", "tyro", "rich", "tensorboardX", "tokenizers", "mujoco", "scipy", "PIL"])
from pathlib import Path
from dataclasses import replace
from motiongen.data.dataset import open_dataset
from motiongen.diffusion.named_configs import named
from motiongen.diffusion.train import train
train(replace(named("mdm"), steps=1, batch=2), open_dataset({str(data.folder)!r}), Path({str(tmp_path)!r}))
"""
    run_python("-W", "error", "-c", code)
    assert int(load_file(tmp_path / "checkpoint.safetensors")["step"]) == 1


@pytest.mark.parametrize("name", ["mdm", "motiondiffuse"])
def test_an_exported_run_says_what_it_is(data: Dataset, tmp_path: Path, name: str) -> None:
    train(SMALL[name], data, tmp_path / "run")
    made = export(data, tmp_path / "run", tmp_path / "m.safetensors")
    assert (made.network, made.schedule, made.prediction) == (name, SMALL[name].schedule, SMALL[name].prediction)
    assert made.sizes["width"] == 32
    assert made.sizes["actions"] == len(made.actions) > 10
    assert made.training["steps"] == "4"
    assert made.licence == "Apache-2.0"
    average = load_file(tmp_path / "run/checkpoint.safetensors")
    assert all(np.allclose(made.tensors[k], average[f"average.{k}"], atol=1e-3) for k in made.tensors)


def test_eight_bits_are_off_by_half_a_step_at_most(data: Dataset, run: Path, tmp_path: Path) -> None:
    whole = export(data, run, tmp_path / "whole.safetensors")
    small = export(data, run, tmp_path / "small.safetensors", eight_bits=True)
    average = load_file(run / "checkpoint.safetensors")
    matrices = [k for k, v in whole.tensors.items() if v.ndim == 2]
    for name in matrices:
        exact = average[f"average.{name}"]
        step = np.abs(exact).max(1, keepdims=True) / 127
        assert (np.abs(small.tensors[name] - exact) <= step * 0.5001 + 1e-9).all()
    assert len(matrices) > 10
    assert all(np.array_equal(small.tensors[k], v) for k, v in whole.tensors.items() if v.ndim != 2)
    assert (tmp_path / "small.safetensors").stat().st_size < 0.7 * (tmp_path / "whole.safetensors").stat().st_size


def test_an_exported_run_generates(data: Dataset, run: Path, tmp_path: Path) -> None:
    export(data, run, tmp_path / "m.safetensors")
    generator = DiffusionGenerator(tmp_path / "m.safetensors")
    assert len(generator.generate("nod", seconds=2.0)) == 60
    trained = [c for i, e in enumerate(data.entries) if e.split == "train" for c in data.captions(i)]
    assert generator.familiarity(trained[0]).score > 0.8


def test_free_learns_from_free_clips_alone(data: Dataset, tmp_path: Path) -> None:
    licences = ["Apache-2.0", "CC BY-NC 4.0 (somebody)", "Apache-2.0; CC BY-NC 4.0 (somebody)", "not stated"]
    entries = tuple(replace(e, licence=licences[i % 4]) for i, e in enumerate(data.entries))
    mixed = replace(data, entries=entries)
    free = replace(SMALL["mdm"], free=True)
    train(free, mixed, tmp_path / "run")
    made = export(mixed, tmp_path / "run", tmp_path / "m.safetensors")
    kept = [i for i, e in enumerate(entries) if e.split == "train" and i % 4 == 0]
    assert made.licence == "Apache-2.0"
    assert made.training["clips"] == str(len(kept))
    rows = np.concatenate([mixed.features(i, mirrored) for i in kept for mirrored in (False, True)])
    np.testing.assert_allclose(made.mean, rows.mean(0, dtype=float), atol=1e-5)
    with pytest.raises(ValueError, match="no training clip is free for commercial use; licences: not stated"):
        train(free, replace(data, entries=tuple(replace(e, licence="not stated") for e in entries)), tmp_path / "none")
    with pytest.raises(ValueError, match="holds a run with free True, not False"):
        train(SMALL["mdm"], mixed, tmp_path / "run")


def test_another_network_is_refused_by_the_field(data: Dataset, run: Path) -> None:
    before = (run / "config.json").read_text()
    wider = replace(SMALL["mdm"], model=replace(SIZES["mdm"], width=64))
    with pytest.raises(ValueError, match=r"holds a run with model\.width 32, not 64"):
        train(wider, data, run)
    with pytest.raises(ValueError, match="holds a run with network mdm, not motiondiffuse"):
        train(SMALL["motiondiffuse"], data, run)
    assert (run / "config.json").read_text() == before


@pytest.mark.parametrize("damage", ["cut", "pickle", "empty"])
def test_a_damaged_checkpoint_is_refused(data: Dataset, run: Path, tmp_path: Path, damage: str) -> None:
    whole = (run / "checkpoint.safetensors").read_bytes()
    content = {"cut": whole[: len(whole) // 2], "pickle": pickle.dumps({"step": 3}), "empty": b""}[damage]
    for file in run.iterdir():
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "checkpoint.safetensors").write_bytes(content)
    with pytest.raises(ValueError, match=r"checkpoint\.safetensors: cut short or no checkpoint"):
        train(SMALL["mdm"], data, tmp_path)
    with pytest.raises(ValueError, match=r"checkpoint\.safetensors: cut short or no checkpoint"):
        export(data, tmp_path, tmp_path / "m.safetensors")


def test_a_run_of_before_these_fields_goes_on(data: Dataset, run: Path, tmp_path: Path) -> None:
    """Its config does not say all; its tensors tell whether it fits."""
    for file in ("checkpoint.safetensors", "scale.safetensors", "actions.json"):
        (tmp_path / file).write_bytes((run / file).read_bytes())
    (tmp_path / "config.json").write_text(json.dumps({"steps": 4, "model": {"width": 32, "layers": 1}}))
    train(replace(SMALL["mdm"], steps=5), data, tmp_path)
    assert int(load_file(tmp_path / "checkpoint.safetensors")["step"]) == 5
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ValueError, match=r"of another network \(.*model.*name another folder"):
        train(replace(SMALL["mdm"], model=replace(SIZES["mdm"], width=64)), data, tmp_path)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--data {set} --generator gpt", "no generator 'gpt' to train; there are mdm, free, motiondiffuse, "),
        ("--data {set} --steps 0", "steps must be 1 or more, not 0"),
        ("--data {set} --model.actions 3", "actions is told by the data set"),
        ("--data {set} --prediction noise", "prediction noise has no geometric losses"),
        ("--data nowhere", "nowhere: not a data set"),
    ],
)
def test_bad_use_is_told_in_one_line(
    data: Dataset, tmp_path: Path, options: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = options.format(set=data.folder).split()
    assert main(["train", *given, "--out", str(tmp_path / "run")]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_no_clip_to_train_on(data: Dataset, tmp_path: Path) -> None:
    tested = replace(data, entries=tuple(replace(e, split="test") for e in data.entries))
    with pytest.raises(ValueError, match="no training clip"):
        train(SMALL["mdm"], tested, tmp_path)


def test_the_help_names_every_generator() -> None:
    assert all(f" {name}" in str(verb.__doc__) for name in CONFIGS)


def test_names_stand_for_what_the_papers_say() -> None:
    mdm, diffuse = named("mdm-paper"), named("motiondiffuse-paper")
    assert isinstance(mdm.model, MdmConfig)
    assert (mdm.model.form, mdm.model.layers, mdm.model.width, mdm.batch) == ("encoder", 8, 512, 64)
    assert (diffuse.schedule, diffuse.prediction, diffuse.batch, diffuse.rate) == ("linear", "noise", 1024, 2e-4)
    assert diffuse.weights == LossWeights(0.0, 0.0, 0.0)
    assert named("free") == replace(named("mdm"), free=True)
    with pytest.raises(ValueError, match="ema must be 0 to 1, not 2"):
        require_sound(TrainConfig(ema=2))
    for config in CONFIGS.values():
        require_sound(config)
