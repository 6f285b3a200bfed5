"""`rigcast bus wiggle`, `record`, `identify`: what a unit is asked and shown before it is driven."""

from __future__ import annotations

import sys
from typing import Annotated

from tyro.conf import arg

from retarget.rig import Rig, load_rig
from rigcast import driving, show

Port = Annotated[str, arg(metavar="PORT")]


def wiggle(*, port: Port, rig: str = "puppet", joint: tuple[str, ...] = ()) -> int:
    """Move each joint a little, with 30 % of the torque, and ask whether it went the right way; nothing drives before.

    Exit 1 where one went the wrong way: `rigcast bus calibrate` puts it right.

    Args:
        port: Serial port of the servo bus.
        rig: Name of the rig that is on the bus, or path of its folder.
        joint: Only these, by default all; only all of them let the rig be driven.
    """
    from drivers.servos.wiggle import wiggle as move
    from drivers.trust import Trust, fingerprint, remember

    body = load_rig(rig)
    joints = joint or tuple(s.joint for s in body.servos)

    def ask(name: str, way: int) -> bool:
        return _yes(f"{name}: {_seen(body, name, way)} – did it?")

    bus, clock = driving.bus_on(port, body, gentle=True)
    with bus:
        wrong = move(body, bus, joints, ask, clock)
    for name in wrong:
        show.warn(f"{name} turns the wrong way: rigcast bus calibrate --port {port} --rig {rig} --joint {name}")
    if wrong:
        return 1
    if set(joints) >= {s.joint for s in body.servos}:
        remember(body, fingerprint(body, port), Trust(0))
        print("all joints turn the right way: this unit may be driven, gently at first")
    else:
        print(f"{', '.join(joints)}: the right way; without --joint for all, the rig may be driven")
    return 0


def _seen(rig: Rig, joint: str, way: int) -> str:
    """What the joint should be seen to do, where MuJoCo is there to tell."""
    try:
        from retarget.way import way_of
    except ModuleNotFoundError:
        return f"{'forwards, to larger' if way > 0 else 'backwards, to smaller'} angles"
    return way_of(rig, joint, way)


def _yes(question: str) -> bool:
    print(f"{question} [y/n] ", end="", file=sys.stderr, flush=True)
    while True:
        answer = sys.stdin.readline()
        if not answer:
            raise ValueError("wiggle waits for y or n, and its input has ended")
        if answer.strip().lower()[:1] in ("y", "n"):
            return answer.strip().lower().startswith("y")
        print("y or n? ", end="", file=sys.stderr, flush=True)
