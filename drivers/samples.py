"""A trajectory as what goes on the wire: its hello and its frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.endpoint import StreamError
from drivers.frame import Float32, Frame, State
from drivers.messages import OPEN_LOOP, Hello
from retarget.rig import Rig
from retarget.trajectory import Trajectory

NS = 1_000_000_000
CLOSING_FRAMES = 3  # The end of the stream is said this often: a newest-only link may drop one.


@dataclass(frozen=True)
class Samples:
    """The columns of a trajectory of T frames as frames have them; see `Frame`."""

    pos: Float32
    vel: Float32
    root: Float32
    contacts: NDArray[np.uint32]
    fps: float

    def __len__(self) -> int:
        return len(self.pos)


def samples_of(trajectory: Trajectory, rig: Rig) -> Samples:
    """`trajectory` as the wire has it. Raises StreamError where its joints are not the rig's."""
    if trajectory.joints != rig.joint_names():
        raise StreamError(
            f"the trajectory's joints are not those of rig {rig.name!r}: it was made for {trajectory.rig!r}"
        )
    pos = trajectory.targets.astype(np.float32)
    root = trajectory.qpos[:, :7].astype(np.float32)
    vel = np.gradient(pos, 1 / trajectory.fps, axis=0).astype(np.float32) if len(pos) > 1 else np.zeros_like(pos)
    contacts = np.zeros(len(pos), np.uint32)
    for bit, foot in enumerate(rig.feet):
        if foot.name in trajectory.contacts:
            contacts |= trajectory.contacts[foot.name].astype(np.uint32) << np.uint32(bit)
    return Samples(pos, vel, root, contacts, trajectory.fps)


def frame_at(
    samples: Samples, at: int, rig: Rig, report_id: str, *, stream: int, seq: int, due_ns: int, state: State
) -> Frame:
    """Frame `seq` of `stream`, due at `due_ns`: sample `at`; one that is not played stands still.

    `capture_ns` is the due time: a sender sends each frame when it is due.
    """
    return Frame(
        stream=stream,
        seq=seq,
        rig_hash=rig.hash,
        report_id=report_id,
        capture_ns=due_ns,
        due_ns=due_ns,
        period_ns=round(NS / samples.fps),
        pos=samples.pos[at : at + 1],
        vel=samples.vel[at : at + 1] if state == State.PLAY else np.zeros_like(samples.vel[:1]),
        root=samples.root[at : at + 1],
        contacts=samples.contacts[at : at + 1],
        state=state,
    )


def frames_of(trajectory: Trajectory, rig: Rig, report_id: str, stream: int, start_ns: int) -> Iterator[Frame]:
    """The frames of `trajectory`, one sample each, due from `start_ns` on, and closing frames that say IDLE.

    Raises StreamError where the trajectory's joints are not the rig's.
    """
    samples = samples_of(trajectory, rig)
    for seq in range(len(samples) + CLOSING_FRAMES):
        at, state = min(seq, len(samples) - 1), State.PLAY if seq < len(samples) else State.IDLE
        due = start_ns + round(seq * NS / samples.fps)
        yield frame_at(samples, at, rig, report_id, stream=stream, seq=seq, due_ns=due, state=state)


def hello_for(trajectory: Trajectory, rig: Rig, report_id: str, stream: int, controller: str = OPEN_LOOP) -> Hello:
    """The hello of a stream that plays `trajectory` on `rig`."""
    return Hello(
        rig=rig.name,
        rig_hash=rig.hash,
        joints=rig.joint_names(),
        lower=tuple(j.lower for j in rig.joints),
        upper=tuple(j.upper for j in rig.joints),
        velocity=tuple(j.velocity for j in rig.joints),
        rate_hz=trajectory.fps,
        stream=stream,
        report_id=report_id,
        text="; ".join(label.text for label in trajectory.labels)[:1000],
        source=" ".join(filter(None, (trajectory.source.generator, trajectory.source.weights)))[:1000],
        licence=trajectory.source.licence[:1000],
        controller=controller,
    )
