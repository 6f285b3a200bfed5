"""What the service and its makers tell each other, a line of JSON each: what to make, and what came of it."""

from __future__ import annotations

import msgspec

from drivers.control import Figure
from retarget.rig import Mount


class Setup(msgspec.Struct, frozen=True):
    """What a maker makes motions for. `generator` is "" for one that only cuts; `folder` is where its files go."""

    rig: str
    folder: str
    model: str | None = None
    mount: Mount | None = None
    generator: str = ""
    candidates: int = 1


class Make(msgspec.Struct, frozen=True, tag=True):
    """A motion for `text`, through retargeting and the gate."""

    number: int
    text: str
    seconds: float | None = None
    seed: int = 0
    guidance: float | None = None


class Idle(msgspec.Struct, frozen=True, tag=True):
    """The motion of a rig that has nothing to do: it breathes and sways, or stands still where the gate asks for it."""

    number: int


class Cut(msgspec.Struct, frozen=True, tag=True):
    """The trajectory in `path` up to `frame` and back to rest from there, through the gate as a whole."""

    number: int
    path: str
    frame: int


class Made(msgspec.Struct, frozen=True):
    """What came of request `number`. `path`: the trajectory, "" where none passed. `detail`: why it did not, or what
    there is to say about it. Number 0 answers the setup.
    """

    number: int
    ok: bool
    detail: str = ""
    path: str = ""
    seconds: float = 0.0
    report_id: str = ""
    checks: tuple[Figure, ...] = ()


Job = Make | Idle | Cut
