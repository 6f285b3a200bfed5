"""`rigcast bus wiggle`, `record`, `identify`: what a unit is asked and shown before it is driven."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import UseAppendAction, arg

from retarget.rig import Rig, load_rig
from rigcast import driving, show

if TYPE_CHECKING:
    from drivers.servos.wiggle import Answer

Port = Annotated[str, arg(metavar="PORT")]


def wiggle(*, port: Port, rig: str = "puppet", joint: UseAppendAction[tuple[str, ...]] = ()) -> int:
    """Move each joint a little, with 30 % of the torque, and ask whether it went the right way; nothing drives before.

    Exit 1 where one went the wrong way: `rigcast bus calibrate` puts it right.

    Args:
        port: Serial port of the servo bus.
        rig: Name of the rig that is on the bus, or path of its folder.
        joint: Only these, by default all; only all of them let the rig be driven.
    """
    from drivers.halts import yes_or_no
    from drivers.servos.wiggle import wiggle as move
    from drivers.trust import Trust, fingerprint, remember

    body = load_rig(rig)
    joints = joint or tuple(s.joint for s in body.servos)

    # All of it before: a bus that falls silent, while a model loads, is let go by its guard.
    seen = {(name, way): _seen(body, name, way) for name in joints for way in (1, -1)}
    bus, clock = driving.bus_on(port, body, gentle=True)
    with bus, yes_or_no() as answer:

        def ask(name: str, way: int) -> Answer:
            print(f"{name}: {seen[name, way]} – did it? [y/n]", file=sys.stderr, flush=True)
            return answer

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


def record(*, port: Port, out: Path, rig: str = "puppet", seconds: float = float("inf")) -> int:
    """Show a motion by hand: the torque goes off, you move the rig, any key ends it; `rigcast play` then plays it back.

    Args:
        port: Serial port of the servo bus.
        out: The trajectory (.npz).
        rig: Name of the rig that is on the bus, or path of its folder.
        seconds: End after so long.
    """
    from drivers.halts import any_key
    from drivers.servos.by_hand import shown
    from drivers.signals import caught_signals
    from retarget.files import save_trajectory

    if out.suffix != ".npz":
        raise ValueError(f"{out}: a motion that is shown by hand is written as .npz")
    body = load_rig(rig)
    bus, clock = driving.bus_on(port, body)
    with bus, any_key() as key, caught_signals() as caught:
        print("all limp: move it; any key ends", file=sys.stderr, flush=True)
        trajectory = shown(body, bus, lambda so_far: bool(caught or key() or so_far >= seconds), clock)
    save_trajectory(trajectory, out)
    print(f"wrote {out}: {trajectory.duration:.1f} s; rigcast play {out} --drive {port}")
    return 0


def identify(*, port: Port, rig: str = "puppet", joint: UseAppendAction[tuple[str, ...]] = ()) -> int:
    """Measure speed, delay, friction and backlash of each joint by moving it; motions are then checked with them.

    The rig moves fast: hang it up, and wiggle it before.

    Args:
        port: Serial port of the servo bus.
        rig: Name of the rig that is on the bus, or path of its folder.
        joint: Only these, by default all; the others keep what they have.
    """
    from drivers.measured import save_measured
    from drivers.servos.identify import identify as measure
    from drivers.servos.identify import unlimited

    body = load_rig(rig)
    if port != driving.EMULATED:
        driving.trust_of(body, port)
    bus, clock = driving.bus_on(port, unlimited(body))
    with bus:
        found = measure(body, bus, joint or tuple(s.joint for s in body.servos), clock)
    columns = ("joint", "rad/s", "published", "delay (ms)", "friction (N·m)", "backlash (°)")
    table = show.new_table(*columns, title=f"{body.name} on {port}")
    for name, m in found.items():
        published = next(j.no_load_speed for j in body.joints if j.name == name)
        figures = (m.no_load_speed, published, m.delay * 1e3, m.friction, math.degrees(m.backlash))
        table.add_row(name, *map("{:.{}f}".format, figures, (2, 2, 0, 3, 1)))
    show.console().print(table)
    if port == driving.EMULATED:
        print("not written: an emulated bus is no unit of the rig")
    else:
        print(f"written to {save_measured(body, found)}")
    return 0


def _seen(rig: Rig, joint: str, way: int) -> str:
    """What the joint should be seen to do, where MuJoCo is there to tell."""
    try:
        from retarget.way import way_of
    except ModuleNotFoundError:
        return f"{'forwards, to larger' if way > 0 else 'backwards, to smaller'} angles"
    return way_of(rig, joint, way)
