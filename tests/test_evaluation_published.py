"""The public HumanML3D evaluator: its file, its words, and the mistakes that others made with it."""

from __future__ import annotations

import os
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from motions import skeleton, walk
from torch import nn
from torch.nn.utils.rnn import pack_padded_sequence

from motiongen.evaluation.judges.judge import JudgeError
from motiongen.evaluation.judges.published import MOST_FRAMES, Published, load_published, on_standard_body
from motiongen.evaluation.judges.words import PARTS, GloVe, WordsError, load_glove
from motiongen.formats.humanml import positions_to_features
from motiongen.formats.humanml_npy import humanml_positions
from motiongen.motion import Skeleton

VOCABULARY = ("unk", "sos", "eos", "a", "person", "walk", "bow", "sofa")
TEXTS = ["a/DET person/NOUN walk/VERB", "bow/VERB", " ".join(["a/DET person/NOUN bow/VERB"] * 6)]


def shapes(seen: int = 259) -> dict[str, dict[str, tuple[int, ...]]]:
    """Layers and sizes of `finest.tar`, as the public code builds them."""

    def recurrent(size: int, hidden: int) -> dict[str, tuple[int, ...]]:
        out: dict[str, tuple[int, ...]] = {"hidden": (2, 1, hidden), "input_emb.weight": (hidden, size)}
        out["input_emb.bias"] = (hidden,)
        for end in ("l0", "l0_reverse"):
            for name in ("weight_ih", "weight_hh"):
                out[f"gru.{name}_{end}"] = (3 * hidden, hidden)
            for name in ("bias_ih", "bias_hh"):
                out[f"gru.{name}_{end}"] = (3 * hidden,)
        out |= {"output_net.0.weight": (hidden, 2 * hidden), "output_net.0.bias": (hidden,)}
        out |= {"output_net.1.weight": (hidden,), "output_net.1.bias": (hidden,)}
        return out | {"output_net.3.weight": (512, hidden), "output_net.3.bias": (512,)}

    movement = {"main.0.weight": (512, seen, 4), "main.0.bias": (512,), "main.3.weight": (512, 512, 4)}
    movement |= {"main.3.bias": (512,), "out_net.weight": (512, 512), "out_net.bias": (512,)}
    text = recurrent(300, 512) | {"pos_emb.weight": (300, 15), "pos_emb.bias": (300,)}
    return {"movement_encoder": movement, "motion_encoder": recurrent(512, 1024), "text_encoder": text}


def state(seen: int = 259) -> dict:
    g = torch.Generator().manual_seed(0)
    said: dict = {
        part: {k: 0.05 * torch.randn(*s, generator=g) for k, s in layers.items()}
        for part, layers in shapes(seen).items()
    }
    optimizer = {"state": {0: {"step": 7, "exp_avg": torch.zeros(3)}}, "param_groups": [{"lr": 1e-4, "params": [0]}]}
    return said | {"opt_text_encoder": optimizer, "epoch": 12, "iter": 3456}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("published")
    torch.save(state(), folder / "finest.tar")
    rng = np.random.default_rng(0)
    np.save(folder / "mean.npy", rng.normal(size=263))
    np.save(folder / "std.npy", rng.uniform(0.5, 2, 263))
    np.save(folder / "our_vab_data.npy", rng.normal(size=(len(VOCABULARY), 300)))
    (folder / "words.txt").write_text("\n".join(VOCABULARY))
    return folder


@pytest.fixture(scope="module")
def glove(folder: Path) -> GloVe:
    return load_glove(folder / "our_vab_data.npy", folder / "words.txt")


@pytest.fixture(scope="module")
def judge(folder: Path, glove: GloVe) -> Published:
    return load_published(folder / "finest.tar", folder / "mean.npy", folder / "std.npy", glove)


def features(frames: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(frames, 263))


def run_text(words: torch.Tensor, parts: torch.Tensor, length: int) -> torch.Tensor:
    """The published text encoder, written down a second time with torch's own functions on the raw weights."""
    w = state()["text_encoder"]
    x = words + nn.functional.linear(parts, w["pos_emb.weight"], w["pos_emb.bias"])
    x = nn.functional.linear(x, w["input_emb.weight"], w["input_emb.bias"])
    gru = nn.GRU(512, 512, batch_first=True, bidirectional=True)
    gru.load_state_dict({k.removeprefix("gru."): v for k, v in w.items() if k.startswith("gru.")})
    with torch.no_grad():
        last = gru(pack_padded_sequence(x, [length], batch_first=True), w["hidden"])[1]
    y = nn.functional.linear(torch.cat([last[0], last[1]], -1), w["output_net.0.weight"], w["output_net.0.bias"])
    y = nn.functional.layer_norm(y, (512,), w["output_net.1.weight"], w["output_net.1.bias"])
    return nn.functional.linear(nn.functional.leaky_relu(y, 0.2), w["output_net.3.weight"], w["output_net.3.bias"])


def run_motion(clip: np.ndarray, mean: np.ndarray, std: np.ndarray) -> torch.Tensor:
    """The published movement and motion encoders on one clip, padded to 196 frames with zeros as their loader does."""
    said = state()
    w = said["movement_encoder"]
    frames = min(len(clip), MOST_FRAMES) // 4 * 4
    x = torch.zeros(1, MOST_FRAMES, 259)
    x[0, :frames] = torch.from_numpy(((clip - mean) / std)[:frames, :-4])
    for conv in ("main.0", "main.3"):
        x = nn.functional.conv1d(x.transpose(1, 2), w[f"{conv}.weight"], w[f"{conv}.bias"], 2, 1).transpose(1, 2)
        x = nn.functional.leaky_relu(x, 0.2)
    x = nn.functional.linear(x, w["out_net.weight"], w["out_net.bias"])
    w = said["motion_encoder"]
    x = nn.functional.linear(x, w["input_emb.weight"], w["input_emb.bias"])
    gru = nn.GRU(1024, 1024, batch_first=True, bidirectional=True)
    gru.load_state_dict({k.removeprefix("gru."): v for k, v in w.items() if k.startswith("gru.")})
    with torch.no_grad():
        last = gru(pack_padded_sequence(x, [frames // 4], batch_first=True), w["hidden"])[1]
    y = nn.functional.linear(torch.cat([last[0], last[1]], -1), w["output_net.0.weight"], w["output_net.0.bias"])
    y = nn.functional.layer_norm(y, (1024,), w["output_net.1.weight"], w["output_net.1.bias"])
    return nn.functional.linear(nn.functional.leaky_relu(y, 0.2), w["output_net.3.weight"], w["output_net.3.bias"])


def test_motions_are_embedded_as_published(judge: Published) -> None:
    clips = [features(n, seed=n) for n in (40, 61, 130, 196, 250)]
    ours = judge.embed_features(clips)
    for row, clip in zip(ours, clips, strict=True):
        assert np.allclose(row, run_motion(clip, judge.mean, judge.std)[0].numpy(), atol=1e-5)


def test_a_caption_is_as_long_as_its_own_words(judge: Published, glove: GloVe) -> None:
    """MDM's first figures were wrong here: every caption was taken to be as long as the padded one, 22 words."""
    together = judge.embed_texts(TEXTS)
    for row, text in zip(together, TEXTS, strict=True):
        words, parts = map(torch.from_numpy, glove.look_up(text))
        assert np.allclose(row, run_text(words[None], parts[None], len(words))[0].numpy(), atol=1e-5)
    words, parts = map(torch.from_numpy, glove.look_up(TEXTS[1]))
    unknown = torch.from_numpy(glove.vectors[glove.row["unk"]]).expand(22 - len(words), -1)
    tags = torch.eye(len(PARTS))[-1:].expand(22 - len(words), -1)
    wrong = run_text(torch.cat([words, unknown])[None], torch.cat([parts, tags])[None], 22)[0].numpy()
    assert np.abs(together[1] - wrong).max() > 1e-2  # what the mistake would have given


def test_rows_come_back_in_the_order_in_which_they_went_in(judge: Published) -> None:
    clips = [features(n, seed=n) for n in (120, 40, 80)]
    assert np.allclose(judge.embed_features(clips)[::-1], judge.embed_features(clips[::-1]), atol=1e-5)
    assert np.allclose(judge.embed_texts(TEXTS)[::-1], judge.embed_texts(TEXTS[::-1]), atol=1e-5)


def test_contacts_are_not_seen(judge: Published) -> None:
    clip = features(60)
    other = clip.copy()
    other[:, -4:] = 7
    assert np.array_equal(judge.embed_features([clip]), judge.embed_features([other]))


def test_motions_are_put_on_the_data_sets_body(judge: Published) -> None:
    clip = walk(1.2, seconds=3)
    assert judge.name == "guo-HumanML3D"
    where = humanml_positions(on_standard_body(clip))
    shin = np.linalg.norm(where[:, 7] - where[:, 4], axis=-1)
    assert np.allclose(shin, 0.4290, atol=1e-4)
    by_hand = judge.embed_features([positions_to_features(where)])
    assert np.allclose(judge.embed_motions([clip]), by_hand, atol=1e-6)
    body = clip.skeleton
    small = Skeleton(body.names, body.parents, body.offsets * 0.5, (0.04, 0.01))
    child = replace(clip, root_pos=clip.root_pos * 0.5, skeleton=small)
    assert np.allclose(judge.embed_motions([child]), by_hand, atol=1e-4)


def test_words_and_parts_of_speech(glove: GloVe) -> None:
    vectors, parts = glove.look_up("a/DET person/NOUN walk/VERB sofa/ODD zebra/NOUN")
    assert np.array_equal(vectors[:2], glove.vectors[[1, 3]])
    assert np.array_equal(vectors[[5, 6]], glove.vectors[[0, 2]])
    named = [PARTS[i] for i in parts.argmax(1)]
    assert named == ["OTHER", "DET", "NOUN", "Act_VIP", "OTHER", "OTHER", "OTHER"]
    assert len(glove.look_up(TEXTS[0] * 1)[0]) == 5
    assert len(glove.look_up(" ".join(["a/DET"] * 30))[0]) == 22
    for bad in ("", "a person", "a/b/c"):
        with pytest.raises(ValueError, match="is not tagged"):
            glove.look_up(bad)


class Malice:
    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self):
        return os.mkdir, (str(self._path),)


def test_a_file_that_would_run_code_is_refused(folder: Path, glove: GloVe, tmp_path: Path) -> None:
    torch.save({"movement_encoder": Malice(tmp_path / "owned")}, tmp_path / "finest.tar")
    (tmp_path / "plain.tar").write_bytes(pickle.dumps(Malice(tmp_path / "owned")))
    np.save(tmp_path / "objects.npy", np.array([Malice(tmp_path / "owned")]), allow_pickle=True)
    for name in ("finest.tar", "plain.tar"):
        with pytest.raises(JudgeError, match="refused, it holds more than tensors"):
            load_published(tmp_path / name, folder / "mean.npy", folder / "std.npy", glove)
    with pytest.raises(JudgeError, match=r"objects\.npy"):
        load_published(folder / "finest.tar", tmp_path / "objects.npy", folder / "std.npy", glove)
    with pytest.raises(WordsError, match="refused, reading a pickle can run code"):
        load_glove(folder / "our_vab_data.npy", folder / "our_vab_words.pkl")
    with pytest.raises(WordsError, match=r"objects\.npy"):
        load_glove(tmp_path / "objects.npy", folder / "words.txt")
    assert not (tmp_path / "owned").exists()


def test_weights_of_another_shape_are_named(folder: Path, glove: GloVe, tmp_path: Path) -> None:
    def load(said: object) -> Published:
        torch.save(said, tmp_path / "finest.tar")
        return load_published(tmp_path / "finest.tar", folder / "mean.npy", folder / "std.npy", glove)

    said = state()
    said["motion_encoder"]["gru.weight_hh_l0"] = torch.zeros(30, 10)
    with pytest.raises(JudgeError, match=r"gru.weight_hh_l0 is \(30, 10\), expected \(3072, 1024\)"):
        load(said)
    said = state()
    del said["text_encoder"]["hidden"]
    with pytest.raises(JudgeError, match=r"text_encoder.hidden is missing, expected \(2, 1, 512\)"):
        load(said)
    with pytest.raises(JudgeError, match="no movement_encoder in it"):
        load({"estimator": {}})
    with pytest.raises(JudgeError, match="holds a list"):
        load([1])
    with pytest.raises(JudgeError, match=r"mean.npy: \(263,\), expected \(251,\)"):
        load(state(247))  # KIT-ML's network with HumanML3D's mean
    (tmp_path / "finest.tar").write_bytes(b"nothing of the kind")
    with pytest.raises(JudgeError, match=r"finest.tar"):
        load_published(tmp_path / "finest.tar", folder / "mean.npy", folder / "std.npy", glove)
    with pytest.raises(JudgeError, match="no such file"):
        load_published(tmp_path / "none.tar", folder / "mean.npy", folder / "std.npy", glove)


def test_bad_clips_are_named(judge: Published) -> None:
    with pytest.raises(ValueError, match=r"clip 1 is \(50, 251\), expected \(at least 4, 263\)"):
        judge.embed_features([features(50), features(50)[:, :251]])
    broken = features(50)
    broken[3, 3] = np.nan
    with pytest.raises(ValueError, match="clip 0 holds NaN"):
        judge.embed_features([broken])
    clip = walk(seconds=1)
    body = skeleton()
    other = replace(clip, skeleton=Skeleton(("hips", *body.names[1:]), body.parents, body.offsets))
    with pytest.raises(ValueError, match="hips"):
        judge.embed_motions([other])
