"""Timelines, actions and nothing at all: what the file may say, whose features are whose, and what is drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from motiongen.compose.parts import PARTS
from motiongen.diffusion.draw import require_known
from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.diffusion.timeline import Entry, TimelineError, columns_of, read_timeline
from motiongen.diffusion.weights import FOLDER, WeightsError, load_weights, save_weights
from motiongen.features import CONTACTS, TURNS
from motiongen.generator import PromptError, load_generator, require_control
from motiongen.motion import Motion

ACTIONS = ("bow", "wave-left", "wave-right")


@pytest.fixture(scope="module")
def generator():
    return load_generator()


@pytest.fixture(scope="module")
def actor(tmp_path_factory: pytest.TempPathFactory) -> DiffusionGenerator:
    """The model in the tree with three actions of random vectors."""
    weights = load_weights(FOLDER / "mdm.safetensors")
    width = len(weights.tensors["no_sentence"])
    table = np.random.default_rng(0).normal(0, 1, (len(ACTIONS), width)).astype(np.float32)
    path = tmp_path_factory.mktemp("weights") / "actor.safetensors"
    save_weights(replace(weights, tensors=weights.tensors | {"action.weight": table}, actions=ACTIONS), path)
    return DiffusionGenerator(path)


def apart(a: Motion, b: Motion) -> float:
    return float(np.abs(a.positions() - b.positions()).max())


# ---- The file


def test_a_file_of_entries(tmp_path: Path) -> None:
    path = tmp_path / "timeline.txt"
    path.write_text(
        "# text # start # end # parts\n\nwalk forward # 0 # 5.5\n"
        "  wave  # 3s#8 #left_arm, head\n\t# a note\nbow # 5 # 10 #\n"
    )
    assert read_timeline(path) == (
        Entry("walk forward", 0.0, 5.5),
        Entry("wave", 3.0, 8.0, ("left_arm", "head")),
        Entry("bow", 5.0, 10.0),
    )


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("walk # 0 # 4\nbow # 5 # 8", "nothing is said between 4 and 5 s"),
        ("walk # 1 # 4", "nothing is said between 0 and 1 s"),
        ("walk # 0 # 4\nbow # -1 # 8", "line 2: 'bow' from -1 to 8 s: times start at 0"),
        ("# a note\n\nwalk # 4 # 2", "line 3: 'walk' from 4 to 2 s: it must end"),
        ("walk # 0 # 0.1", "it must end 0.5 s or more after its start"),
        ("walk # 0 # 4 # tail", "line 1: unknown part of the body 'tail'; there are left_arm"),
        ("walk # 0", "write: text # start # end"),
        ("walk # 0 # 4 # head # 5", "write: text # start # end"),
        ("walk # zero # 4", "'zero' is no number of seconds"),
        ("walk # 0 # nan", "times start at 0"),
        (" # 0 # 4", "no entries"),
        ("\n# nothing\n", "no entries"),
        ("walk # 0 # 7200", "at most 600 s"),
        ("\n".join(f"walk # {i} # {i + 1}" for i in range(1000)), "1000 entries; at most 100 are taken"),
    ],
)
def test_bad_files_are_one_line(tmp_path: Path, lines: str, words: str) -> None:
    path = tmp_path / "timeline.txt"
    path.write_text(lines)
    with pytest.raises(TimelineError) as error:
        read_timeline(path)
    assert words in str(error.value)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "timeline.txt"
    path.write_bytes(b"\xff\xfe\x00walk")
    with pytest.raises(TimelineError, match="not a text file"):
        read_timeline(path)


# ---- Whose features are whose


def test_parts_share_the_features_out() -> None:
    upper, lower = columns_of(["upper_body"]), columns_of(["lower_body"])
    assert (upper ^ lower).all()
    assert lower[: TURNS.start].all()
    assert lower[CONTACTS].all()
    assert columns_of([]).all()
    assert columns_of(["whole_body"]).all()
    assert columns_of(["legs"])[: TURNS.start].all()  # the way they go, but not how the pelvis is turned
    assert not columns_of(["left_leg"])[: TURNS.start].any()
    assert list(columns_of(["left_leg"])[CONTACTS]) == [True, True, False, False]
    for part, joints in PARTS.items():
        assert columns_of([part])[TURNS].sum() == 6 * len(joints)


# ---- What is drawn


def test_one_entry_is_the_plain_generator(generator) -> None:
    alone = generator.generate("walk forward", seconds=4, seed=3)
    assert apart(generator.generate_timeline([Entry("walk forward", 0, 4)], seed=3), alone) < 1e-6


def test_one_thing_after_another(generator) -> None:
    out = generator.generate_timeline([Entry("walk forward", 0, 4), Entry("bow", 4, 8)], seed=1)
    assert len(out) == 240
    assert [(label.text, label.start_s, label.end_s) for label in out.labels] == [("walk forward", 0, 4), ("bow", 4, 8)]
    way = np.linalg.norm(np.diff(out.root_pos[:, :2], axis=0), axis=1)
    assert way[:100].sum() > 3 * way[140:].sum()
    assert np.ptp(out.positions()[140:, out.skeleton.index("head"), 2]) > 0.1
    step = np.linalg.norm(np.diff(out.positions(), axis=0), axis=-1) * out.fps
    assert step.max() < 15


def test_parts_at_the_same_time(generator) -> None:
    entries = [Entry("walk forward", 0, 5), Entry("raise both hands", 1, 5, ("arms",))]
    walks, both = (generator.generate_timeline(said, seed=2) for said in (entries[:1], entries))
    wrist = [both.skeleton.index(f"{side}_wrist") for side in ("left", "right")]
    higher = (both.positions() - walks.positions())[60:140, wrist, 2]
    assert higher.mean() > 0.3
    assert np.linalg.norm(both.root_pos[-1, :2]) > 1.0


def test_where_nobody_speaks_of_a_part_anything_may_happen(generator) -> None:
    out = generator.generate_timeline([Entry("wave", 0, 3, ("right_arm",))], seed=0)
    assert len(out) == 90


def test_longer_than_the_window(generator) -> None:
    entries = [Entry("walk forward", 0, 14), Entry("walk forward", 14, 25)]
    out = generator.generate_timeline(entries, seed=0)
    assert len(out) == 750
    assert np.linalg.norm(out.root_pos[-1, :2]) > 3


def test_actions(actor: DiffusionGenerator) -> None:
    out = actor.generate_action("bow", seconds=2, seed=1)
    assert (len(out), out.labels[0].text) == (60, "bow")
    assert apart(out, actor.generate_action("Bow", seconds=2, seed=1)) == 0
    assert apart(out, actor.generate_action("wave left", seconds=2, seed=1)) > 1e-3
    chosen = {actor.generate_action("wave", seconds=1, seed=s).labels[0].text for s in range(6)}
    assert chosen == {"wave left", "wave right"}


def test_unknown_actions_name_the_nearest(actor: DiffusionGenerator) -> None:
    with pytest.raises(PromptError, match=r"no action 'greet-people'; the nearest are wave-"):
        actor.generate_action("greet people")
    with pytest.raises(PromptError, match="between 1 and 60"):
        actor.generate_action("bow", seconds=0.1)


def test_nothing_said(generator) -> None:
    a, b = (generator.generate_unconditioned(seconds=2, seed=s) for s in (0, 1))
    assert len(a) == 60
    assert apart(a, b) > 1e-3
    assert apart(a, generator.generate_unconditioned(seconds=2, seed=0)) == 0


def test_a_model_that_always_needs_a_text(tmp_path: Path) -> None:
    path = tmp_path / "said.safetensors"
    save_weights(replace(load_weights(FOLDER / "mdm.safetensors"), unconditioned=False), path)
    with pytest.raises(PromptError, match="with texts only"):
        DiffusionGenerator(path).generate_unconditioned()


def test_no_timeline_and_other_generators(generator) -> None:
    with pytest.raises(TimelineError, match="no entries"):
        generator.generate_timeline([])
    with pytest.raises(PromptError, match="gestures follows one text only"):
        require_control(load_generator("gestures"), "gestures")


@pytest.mark.parametrize("what", ["network", "schedule", "prediction"])
def test_weights_of_something_else(what: str) -> None:
    weights = replace(load_weights(FOLDER / "mdm.safetensors"), **{what: "other"})
    with pytest.raises(WeightsError, match=f"file: {what} 'other'; this rigcast knows"):
        require_known(weights, "file")


def test_the_page_of_docs_runs() -> None:
    page = (Path(__file__).parent.parent / "docs" / "control.md").read_text(encoding="utf-8")
    code = page.split("```python\n")[1].split("```")[0]
    names: dict[str, Motion] = {}
    exec(code, names)
    assert len(names["between"]) == len(names["waving"]) == len(names["walk"]) == 120
    assert len(names["story"]) == 210
