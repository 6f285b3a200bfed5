"""How close a text is to what a model was trained on."""

from __future__ import annotations

from motiongen.diffusion.said import Encoder
from motiongen.diffusion.weights import Bank, nearest
from motiongen.generator import Familiarity, check_prompt


def familiarity(bank: Bank, encoder: Encoder, text: str) -> Familiarity:
    """By the nearest caption of the model's `bank`; raises PromptError for a text that nobody could follow."""
    best = nearest(bank, encoder([check_prompt(text)])[2][0])
    names = tuple(bank.contents[i].replace("-", " ") for _, i in best[:3])
    return Familiarity(best[0][0] >= bank.known, best[0][0], names)
