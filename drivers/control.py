"""What is said on the control socket: what the rig shall do next, what became of it, and how things stand.

MessagePack maps as in `drivers.messages`, from a sender to the publisher and back. A `Stop` goes the same way; every
publisher takes it, from every key that is known to it. The others are for a service (`rigcast serve`).
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from drivers.messages import Mode, Stop, Text, decoded

MOST_TEXT = 1000
MOST_WAITING = 64

Id = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
Name = Annotated[str, msgspec.Meta(max_length=64, pattern=r"\A[\w.@-]*\Z")]  # of a sender: it is shown to others
Event = Literal[
    "refused", "queued", "making", "ready", "rejected", "playing", "played", "dropped", "stopped", "resting"
]
ENDS: tuple[Event, ...] = ("refused", "rejected", "played", "dropped", "stopped", "resting")


class Say(msgspec.Struct, frozen=True, tag="rigcast.say.1", tag_field="type"):
    """Do what `text` says: after what is waiting or, with `replace`, instead of it and of what plays now.

    `id` names the request in every answer to it. `seconds`, `seed` and `guidance` are the generator's. `sender`: who
    asks, where no key tells.
    """

    id: Id
    text: Annotated[str, msgspec.Meta(max_length=MOST_TEXT)]
    seconds: Annotated[float, msgspec.Meta(gt=0, le=3600)] | None = None
    seed: Annotated[int, msgspec.Meta(ge=0, lt=1 << 62)] = 0
    guidance: Annotated[float, msgspec.Meta(ge=-100, le=100)] | None = None
    replace: bool = False
    sender: Name = ""


class Rest(msgspec.Struct, frozen=True, tag="rigcast.rest.1", tag_field="type"):
    """Forget what waits, lead what plays back to rest and stay in the idle motion."""

    id: Id
    sender: Name = ""


class Look(msgspec.Struct, frozen=True, tag="rigcast.look.1", tag_field="type"):
    """Tell me how things stand; answered with a `Status`."""

    id: Id
    sender: Name = ""


class Figure(msgspec.Struct, frozen=True):
    """One check of the physics report: what was found, what is allowed, and what to do about it."""

    name: Text
    value: float
    limit: float
    unit: Text
    ok: bool
    advice: Text


class Told(msgspec.Struct, frozen=True, tag="rigcast.told.1", tag_field="type"):
    """What became of the request `id`: `detail` says why, `checks` and `report_id` what the gate found.

    A request ends with one of `ENDS`. `seconds`: how long the motion is, 0 where there is none yet.
    """

    id: Annotated[str, msgspec.Meta(max_length=64)]
    event: Event
    detail: Text = ""
    seconds: float = 0.0
    report_id: Annotated[str, msgspec.Meta(max_length=16)] = ""
    checks: Annotated[tuple[Figure, ...], msgspec.Meta(max_length=64)] = ()


class RigStatus(msgspec.Struct, frozen=True):
    """A rig as the service last heard of it, `age_s` s ago. `clock_s`: its clock less ours, ± `clock_error_s`."""

    rig: Text
    sender: Text
    mode: Mode
    reason: Text
    age_s: float
    clock_s: float
    clock_error_s: float


class Status(msgspec.Struct, frozen=True, tag="rigcast.status.1", tag_field="type"):
    """How things stand. `mode`: idle, playing, resting (a rig is not well: `reason`) or stopped for good (`reason`).

    `playing`: the text that is shown now, "" while idle, `left_s` s from its end. `owner`: who alone may say what is
    next, "" where everybody may.
    """

    id: Annotated[str, msgspec.Meta(max_length=64)]
    rig: Text
    generator: Text
    mode: Literal["idle", "playing", "resting", "stopped"]
    reason: Text
    playing: Text
    left_s: float
    waiting: Annotated[tuple[Text, ...], msgspec.Meta(max_length=MOST_WAITING)]
    owner: Text
    rigs: Annotated[tuple[RigStatus, ...], msgspec.Meta(max_length=MOST_WAITING)]


Request = Say | Rest | Look | Stop
Answer = Told | Status


def request_in(data: bytes) -> Request:
    """The request in `data`; raises FrameError where it is not exactly one."""
    return decoded(data, Request, "request")


def answer_in(data: bytes) -> Answer:
    """The answer in `data`; raises FrameError where it is not exactly one."""
    return decoded(data, Answer, "answer")
