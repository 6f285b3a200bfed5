"""`rigcast view`: draw what is on the wire. It follows unchecked streams too, for it moves nothing."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from tyro.conf import Positional, arg

from drivers.endpoint import DEFAULT
from retarget.rig import Rig, load_rig
from rigcast import show

if TYPE_CHECKING:
    from drivers.frame import Frame
    from drivers.receiver import Receiver
    from sim.view import Pose, Poses

FILM_FPS = 25.0
RECORDED = ".rigrec"
PAUSE_NS = 1_000_000_000


def view(
    endpoint: Annotated[Positional[str], arg(metavar="ENDPOINT")] = DEFAULT,
    /,
    *,
    rig: str = "puppet",
    on: Literal["native", "web"] = "native",
    port: int = 8080,
    film: Annotated[Path | None, arg(metavar="FILE")] = None,
    seconds: float = 5.0,
    leader: str = "",
    insecure: bool = False,
) -> int:
    """Show the stream on ENDPOINT in a window or in the browser until closed or Ctrl-C, or film a part of it.

    Args:
        endpoint: Where `say --publish` streams to, or a recording (.rigrec), which is shown over and over.
        rig: Name of the rig that is streamed, or path of its folder.
        on: A MuJoCo window, or a page on this machine.
        port: Port of the page, on 127.0.0.1.
        film: Write an .mp4 or .gif of what arrives instead of showing it.
        seconds: Length of the film.
        leader: Name of the key that streams (see `rigcast keys`); by default the only one that may.
        insecure: Follow a stream of another machine without keys.
    """
    from drivers.endpoint import endpoints
    from drivers.keys import keys_for
    from drivers.receiver import Receiver

    body = load_rig(rig)
    if endpoint.endswith(RECORDED):
        return _show(body, recorded(Path(endpoint), body), on, port, film, seconds)
    keys = keys_for(endpoints(endpoint), insecure=insecure, leader=leader)
    with Receiver(
        endpoint, rig_hash=body.hash, rig=body.name, preview=True, keys=keys, leader=leader, insecure=insecure
    ) as receiver:
        return _show(body, following(receiver), on, port, film, seconds)


def _show(body: Rig, poses: Poses, on: Literal["native", "web"], port: int, film: Path | None, seconds: float) -> int:
    if film is not None:
        return _film(poses, film, seconds, body)
    from sim.view import view_native, view_web

    with suppress(KeyboardInterrupt):
        if on == "native":
            view_native(body, poses)
        else:
            view_web(body, poses, port=port)
    return 0


def following(receiver: Receiver, clock: Callable[[], int] = time.monotonic_ns) -> Poses:
    """The newest pose on the wire (root position, root quaternion, joints); None until one came.

    Warns of a publisher that cannot be followed, and of a rig on the stream that is not well.
    """
    newest: Pose | None = None
    tell_trouble, tell_unwell = show.warner(), show.warner()

    def poses() -> Pose | None:
        nonlocal newest
        frame = receiver.poll(clock())
        tell_trouble(receiver.trouble)
        tell_unwell(receiver.roster.unwell())
        newest = newest if frame is None else pose_due(frame, receiver.gate.sender_ns(clock()))
        return newest

    return poses


def recorded(path: Path, rig: Rig, clock: Callable[[], int] = time.monotonic_ns) -> Poses:
    """The pose of the moment in a recording, which begins now and starts over a second after its end.

    Raises StreamError where it holds no frame for `rig`.
    """
    from drivers.recorded import frames_in
    from drivers.recording import Recording
    from rigcast.record import warn_of_lost

    recording = Recording(path)
    frames = list(frames_in(recording, rig))
    warn_of_lost(path, recording)
    dues = np.maximum.accumulate([due for due, _ in frames])
    began = clock()

    def poses() -> Pose:
        at = int(dues[0]) + (clock() - began) % int(dues[-1] - dues[0] + PAUSE_NS)
        due, frame = frames[int(np.searchsorted(dues, at, side="right")) - 1]
        return pose_due(frame, frame.due_ns + at - due)

    return poses


def pose_due(frame: Frame, sender_ns: int) -> Pose:
    """The sample of `frame` that is due at `sender_ns` on its sender's clock; its first or last where none is."""
    sample = min(max((sender_ns - frame.due_ns) // frame.period_ns, 0), len(frame.pos) - 1)
    root = frame.root[sample].astype(float)
    return root[:3], root[3:], frame.pos[sample].astype(float)


def _film(poses: Poses, path: Path, seconds: float, rig: Rig) -> int:
    from sim.render import render_video

    rows: list[np.ndarray] = []
    began = time.monotonic()
    for k in range(round(seconds * FILM_FPS)):
        time.sleep(max(0.0, began + k / FILM_FPS - time.monotonic()))
        if (pose := poses()) is not None:
            rows.append(np.concatenate(pose))
    if not rows:
        show.warn(f"no frame for rig {rig.name!r} came within {seconds:g} s")
        return 1
    render_video(np.array(rows), FILM_FPS, rig, path)
    print(f"wrote {path}")
    return 0
