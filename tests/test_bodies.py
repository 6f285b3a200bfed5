"""Parts of the body on bodies of their own: who shares one, and that each is drawn as its text alone would be."""

import numpy as np
import pytest

from motiongen.diffusion import said
from motiongen.diffusion.bodies import bodies_of, followed
from motiongen.diffusion.draw import Drawing, draw, whole
from motiongen.diffusion.mixing import Span
from motiongen.diffusion.timeline import Entry, columns_of, passes_of
from motiongen.diffusion.weights import FOLDER, load_weights
from motiongen.text.encoder import TextEncoder

WHOLE, ARM = np.ones(140, bool), columns_of(["right_arm"])


@pytest.mark.parametrize(("own_bodies", "alike"), [(True, True), (False, False)])
def test_a_part_is_drawn_as_its_text_alone(own_bodies: bool, alike: bool) -> None:
    model, encoder = load_weights(FOLDER / "mdm.safetensors"), TextEncoder()
    how = Drawing("ddim", 4, 1.5, lam_parts=0.0, own_bodies=own_bodies)
    walk, wave = Entry("walk forward", 0, 2), Entry("wave with the right hand", 0, 2, ("right_arm",))
    passes, count = passes_of(model, [walk, wave], encoder)
    both = draw(model, passes, [count], [3], how)
    alone = draw(model, whole(model, said.texts(encoder, [wave.text]), count), [count], [3], how)
    apart = np.abs(both - alone).max((0, 1))
    assert (apart[ARM].max() < 1e-4) == alike
    assert apart[~ARM].max() > 0.5


def test_who_speaks_of_one_part_in_turn_shares_a_body() -> None:
    head = columns_of(["head"])
    spans = [Span(0, 90, WHOLE), Span(0, 40, ARM), Span(30, 60, head), Span(28, 90, ARM)]
    assert [body.voices for body in bodies_of(spans, 12)] == [(1, 3), (2,)]


def test_a_body_follows_its_voices_and_else_the_mixture() -> None:
    spans = [Span(0, 90, WHOLE), Span(0, 40, ARM), Span(28, 70, ARM)]
    (body,) = bodies_of(spans, 12)
    mixed = np.zeros((2, 90, 140), np.float32)
    out = followed(body, mixed, [mixed + 9, mixed[:, :40] + 1, mixed[:, 28:70] + 1], spans)
    assert (out[:, :28] == 1).all()  # the first alone
    np.testing.assert_allclose(out[:, 28:58], 1, atol=1e-6)  # one fades into the other
    assert (np.diff(out[0, 58:71, 0]) < 0).all()  # and back to the mixture
    assert (out[:, 70:] == 0).all()


def test_whole_bodies_need_no_other() -> None:
    assert bodies_of([Span(0, 60, WHOLE), Span(40, 90, WHOLE)], 12) == []
