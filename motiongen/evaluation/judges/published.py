"""The public evaluators of Guo et al. 2022 for HumanML3D and KIT-ML, from the weights that a user has (`finest.tar`).

Layer names and sizes are those of the public code (EricGuo5513/text-to-motion; MDM uses the same file). Nothing here
unpickles: weights are read with `weights_only`, word vectors from an `.npy` and a text file.

Three mistakes that public evaluation code has made cannot be made through this interface. A caption is as long as its
own list of words (MDM's first figures took the padded length: its authors ask not to cite them). Motions come in the
data set's units and are normalised here, once, by the evaluator's own mean and deviation, be they for MultiModality or
not. Rows come back in the order in which they went in.
"""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from motiongen.evaluation.judges.guo import UNIT, Guo, GuoConfig
from motiongen.evaluation.judges.judge import JudgeError, by_length, padded
from motiongen.evaluation.judges.seen import leg_length
from motiongen.evaluation.judges.words import PARTS, GloVe
from motiongen.formats.humanml import HUMANML3D, LAYOUTS, Layout, positions_to_features
from motiongen.formats.humanml_npy import humanml_positions
from motiongen.motion import SMPL_JOINTS, Motion
from motiongen.nn import Floats
from motiongen.rotation import Array
from motiongen.smpl import SMPL_SKELETON

MOST_FRAMES = 196  # the published loader pads every clip to as many
CONTACTS = 4  # columns at the end of the features that the evaluator does not see
_PARTS = ("movement_encoder", "motion_encoder", "text_encoder")


@dataclass(frozen=True)
class Published:
    """An `Evaluator`: the network, the features it was trained on, its own `mean` and `std` of them, its words."""

    network: Guo
    layout: Layout
    mean: Floats
    std: Floats
    glove: GloVe

    @property
    def name(self) -> str:
        return f"guo-{self.layout.name}"

    @torch.inference_mode()
    def embed_texts(self, texts: Sequence[str]) -> Array:
        """Embeddings (N, 512) of tagged texts as the data set has them: "a/DET man/NOUN walk/VERB".

        Raises ValueError for a text that is blank or not tagged.
        """
        lines = [self.glove.look_up(text) for text in texts]

        def embed(part: list[tuple[Floats, Floats]]) -> torch.Tensor:
            longest = max(len(words) for words, _ in part)
            x = np.zeros((len(part), longest, part[0][0].shape[1]), np.float32)
            tags, mask = np.zeros((len(part), longest, len(PARTS)), np.float32), np.zeros((len(part), longest), bool)
            for i, (words, parts) in enumerate(part):
                x[i, : len(words)], tags[i, : len(words)], mask[i, : len(words)] = words, parts, True
            return self.network.embed_texts(*map(torch.from_numpy, (x, mask, tags)))

        return by_length(lines, embed, lambda line: len(line[0]))

    def embed_motions(self, motions: Sequence[Motion]) -> Array:
        """Embeddings (N, 512) of motions, put on the data set's body by their joint angles.

        Raises ValueError for KIT-ML, whose skeleton is not mapped, and for a skeleton other than SMPL's.
        """
        if self.layout is not HUMANML3D:
            raise ValueError(f"{self.layout.name} has another skeleton: give its features to embed_features")
        return self.embed_features([positions_to_features(humanml_positions(on_standard_body(m))) for m in motions])

    @torch.inference_mode()
    def embed_features(self, clips: Sequence[NDArray[np.floating]]) -> Array:
        """Embeddings (N, 512) of the data set's features (T, 263 or 251) in its units, not normalised by anybody.

        The first 196 frames are seen, in whole snippets of four. Raises ValueError, naming the clip, for another width,
        fewer than four frames, NaN or infinity.
        """
        for i, clip in enumerate(clips):
            if clip.ndim != 2 or clip.shape[1] != self.layout.width or len(clip) < UNIT:
                raise ValueError(f"clip {i} is {clip.shape}, expected (at least {UNIT}, {self.layout.width})")
            if not np.isfinite(clip).all():
                raise ValueError(f"clip {i} holds NaN or infinity")
        mean, std = self.mean[:-CONTACTS], self.std[:-CONTACTS]
        seen = [np.asarray(clip[:, :-CONTACTS], np.float32) for clip in clips]
        return by_length(seen, lambda part: self.network.embed_motions(*padded(part, mean, std, MOST_FRAMES)), len)


def on_standard_body(motion: Motion) -> Motion:
    """The motion with HumanML3D's bone lengths, its joint angles kept, its way scaled by the length of the legs.

    Raises ValueError where its joints are not SMPL's 22.
    """
    if motion.skeleton.names != SMPL_JOINTS:
        raise ValueError(f"expected the {len(SMPL_JOINTS)} joints of SMPL, not {motion.skeleton.names}")
    size = leg_length(SMPL_SKELETON.offsets) / leg_length(motion.skeleton.offsets)
    return replace(motion, root_pos=motion.root_pos * size, skeleton=SMPL_SKELETON)


def load_published(weights: Path, mean: Path, std: Path, glove: GloVe) -> Published:
    """The evaluator in `finest.tar`, with the `mean.npy` and `std.npy` of its own `meta` folder (not the data set's).

    Which data set it is for is told by the shapes. Raises JudgeError where a file is missing, damaged, would run code
    when read, or has layers of other shapes, the first of which is named.
    """
    said = _read(weights)
    if missing := [part for part in _PARTS if not isinstance(said.get(part), dict)]:
        raise JudgeError(f"{weights}: no {missing[0]} in it; expected the finest.tar of text_mot_match")
    tensors = {f"{part}.{k}": v for part in _PARTS for k, v in said[part].items()}
    seen = tensors.get("movement_encoder.main.0.weight", torch.zeros(0, 0)).shape[1]
    layout = LAYOUTS.get(seen + CONTACTS, HUMANML3D)
    config = GuoConfig(
        layout.width - CONTACTS, glove.width, len(PARTS), movement=512, motion=1024, text=512, latent=512
    )
    network = Guo(config)
    for name, ours in network.state_dict().items():
        found = tuple(tensors[name].shape) if name in tensors else "missing"
        if found != tuple(ours.shape):
            raise JudgeError(f"{weights}: {name} is {found}, expected {tuple(ours.shape)}")
    network.load_state_dict({name: tensors[name] for name in network.state_dict()})
    moments = [_moment(path, layout.width) for path in (mean, std)]
    if not (moments[1] > 0).all():
        raise JudgeError(f"{std}: a deviation is not above 0 (column {int((moments[1] <= 0).argmax())})")
    return Published(network.eval(), layout, moments[0], moments[1], glove)


def _read(path: Path) -> dict[str, dict[str, torch.Tensor]]:
    if not path.is_file():
        raise JudgeError(f"{path}: no such file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of pickle protocols that torch may not know: it then refuses
            said = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:
        raise JudgeError(f"{path}: refused, it holds more than tensors and could run code when read") from None
    except (RuntimeError, EOFError, OSError, ValueError) as error:
        raise JudgeError(f"{path}: not a file of torch weights, or damaged ({str(error).splitlines()[0]})") from None
    if not isinstance(said, dict):
        raise JudgeError(f"{path}: holds a {type(said).__name__}; expected the finest.tar of text_mot_match")
    return said


def _moment(path: Path, width: int) -> Floats:
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise JudgeError(f"{path}: {str(error).splitlines()[0]}") from None
    if array.shape != (width,) or not np.isfinite(array).all():
        raise JudgeError(f"{path}: {array.shape}, expected ({width},) finite numbers")
    return array.astype(np.float32)
