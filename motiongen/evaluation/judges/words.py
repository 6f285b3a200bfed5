"""Words as the public HumanML3D evaluator reads them: a GloVe vector and a part of speech for each.

The data set's texts are tagged by its authors ("a/DET man/NOUN walk/VERB", lemmas of nouns and verbs); words that tell
most about motion have tags of their own, whatever they are tagged as. Both lists are those of the published evaluator,
whose first layer was trained on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motiongen.nn import Floats

MOST_WORDS = 20  # of a text that are heard
PARTS = (
    "VERB", "NOUN", "DET", "ADP", "NUM", "AUX", "PRON", "ADJ", "ADV", "Loc_VIP", "Body_VIP", "Obj_VIP", "Act_VIP",
    "Desc_VIP", "OTHER",
)  # fmt: skip
_TELLING = {
    "Loc_VIP": "left right clockwise counterclockwise anticlockwise forward back backward up down straight curve",
    "Body_VIP": "arm chin foot feet face hand mouth leg waist eye knee shoulder thigh",
    "Obj_VIP": "stair dumbbell chair window floor car ball handrail baseball basketball",
    "Act_VIP": "walk run swing pick bring kick put squat throw hop dance jump turn stumble stop sit lift lower raise "
    "wash stand kneel stroll rub bend balance flap jog shuffle lean rotate spin spread climb",
    "Desc_VIP": "slowly carefully fast careful slow quickly happy angry sad happily angrily sadly",
}
_PART_OF = {word: part for part, words in _TELLING.items() for word in words.split()}


class WordsError(ValueError):
    """Word vectors that cannot be used; the message names the file."""


@dataclass(frozen=True)
class GloVe:
    """Word vectors (V, 300) and the row of each word; "unk", "sos" and "eos" are among them."""

    vectors: Floats
    row: dict[str, int]

    @property
    def width(self) -> int:
        return self.vectors.shape[1]

    def look_up(self, text: str) -> tuple[Floats, Floats]:
        """Vectors (N, 300) and parts of speech (N, 15), one-hot, of a tagged text's first 20 words, with the marks of
        its start and end. Raises ValueError where a word has no tag or there is none.
        """
        tokens = text.split()
        if not tokens or any(t.count("/") != 1 for t in tokens):
            raise ValueError(f"{text!r} is not tagged; expected words like walk/VERB, as in the data set's texts")
        pairs = [t.split("/") for t in tokens[:MOST_WORDS]]
        at, parts = [], np.zeros((len(pairs) + 2, len(PARTS)), np.float32)
        for i, (word, tag) in enumerate([["sos", "OTHER"], *pairs, ["eos", "OTHER"]]):
            known = word in self.row
            at.append(self.row[word if known else "unk"])
            part = _PART_OF.get(word, tag) if known else "OTHER"
            parts[i, PARTS.index(part if part in PARTS else "OTHER")] = 1
        return self.vectors[at], parts


def load_glove(vectors: Path, words: Path) -> GloVe:
    """The published vectors: `our_vab_data.npy`, and a text file with a word a line, in the order of its rows.

    The published list of words is a pickle, which is refused. Raises WordsError where a file is missing, is a pickle,
    or does not fit the other.
    """
    if words.suffix != ".txt":
        raise WordsError(
            f"{words}: refused, reading a pickle can run code; give the words as a .txt, one a line by row"
        )
    try:
        array = np.load(vectors, allow_pickle=False)
        lines = words.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise WordsError(f"{vectors}, {words}: {str(error).splitlines()[0]}") from None
    if array.ndim != 2 or len(array) != len(lines) or not np.isfinite(array).all():
        raise WordsError(f"{vectors} {array.shape} does not fit the {len(lines)} words of {words}")
    row = {word.strip(): i for i, word in enumerate(lines)}
    if missing := [w for w in ("unk", "sos", "eos") if w not in row]:
        raise WordsError(f"{words}: no word {missing[0]!r} in it")
    return GloVe(array.astype(np.float32), row)
