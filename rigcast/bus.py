"""`rigcast bus …`: servo buses before and beside a drive: emulate, scan, set-id, monitor, relax, calibrate."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, UseAppendAction, arg

from retarget.rig import Mount, load_rig
from rigcast import show

if TYPE_CHECKING:
    from rich.table import Table

    from drivers.bus import Reading

Port = Annotated[str, arg(metavar="PORT")]


def emulate(
    *,
    rig: str = "puppet",
    tcp: int | None = None,
    physics: bool = False,
    mount: Mount | None = None,
    view: Literal["native", "web", "none"] = "none",
    film: Annotated[Path | None, arg(metavar="FILE")] = None,
) -> int:
    """Emulate the servo bus of a rig until Ctrl-C; prints the port to give to `rigcast drive --port`.

    Args:
        rig: Name of a rig (see `rigcast rigs`) or path of its folder.
        tcp: Listen on this TCP port of this machine, 0 for any, in place of a serial path.
        physics: Let the servos turn the rig's body in MuJoCo: inertia, gravity, friction, heat, a supply that sags.
        mount: How the base of that body is held; by default as the rig says.
        view: Show that body in a window or in the browser.
        film: Write an .mp4 or .gif of what it does from when the torque comes on until it is off again.
    """
    from drivers.emulation.emulator import Emulator
    from drivers.emulation.tcp import TcpEmulator
    from drivers.signals import caught_signals

    description = load_rig(rig)
    body = None
    if physics or view != "none" or film is not None:
        from drivers.emulation.body import Body

        body = Body(description, mount=mount)
    if tcp is None:
        emulated: Emulator | TcpEmulator = Emulator(description, body=body)
    else:
        emulated = TcpEmulator(description, body=body, address=("127.0.0.1", tcp))
    with caught_signals() as caught, emulated as emulator:
        print(emulator.port, flush=True)
        if view == "none" and film is None:
            while not caught:
                time.sleep(0.1)
        else:
            from rigcast.emulated import show_body

            show_body(emulator, description, description.mount if mount is None else mount, view, film, caught)
    return 0


def scan(
    *,
    port: Port,
    protocol: UseAppendAction[tuple[str, ...]] = (),
    baud: UseAppendAction[tuple[int, ...]] = (),
    highest_id: int = 252,
    json: bool = False,
) -> int:
    """Ask every id, at every rate, in every protocol, who is there; nothing is written and nothing moves.

    Exit 1 where nobody answers.

    Args:
        port: Serial port of the servo bus, such as /dev/ttyUSB0.
        protocol: Only these: dynamixel2, dynamixel1, feetech, lx16a.
        baud: Only these rates.
        highest_id: Ask ids from 0 to this one.
        json: Print one JSON document instead of a table.
    """
    from drivers.servos.setup import scan as ask
    from drivers.servos.table import FAMILIES

    def told(name: str, rate: int) -> None:
        print(f"{name} at {rate} baud …", file=sys.stderr, flush=True)

    found = list(ask(port, protocols=protocol or tuple(FAMILIES), bauds=baud, highest_id=highest_id, told=told))
    if json:
        show.print_json([asdict(servo) for servo in found])
    elif not found:
        print(f"nobody answers on {port}: check power and cable, or ask for more protocols, rates and ids")
    else:
        table = show.new_table("id", "model", "protocol", "baud", title=f"{len(found)} servos on {port}")
        for servo in found:
            table.add_row(str(servo.id), servo.model, servo.protocol, str(servo.baud))
        show.console().print(table)
    return 0 if found else 1


def set_id(*, port: Port, protocol: str, old: int, new: int, baud: int = 1_000_000) -> int:
    """Give one servo another id. Its torque goes off; the new id must be free.

    Args:
        port: Serial port of the servo bus.
        protocol: dynamixel2, dynamixel1, feetech or lx16a.
        old: The id that it has.
        new: The id that it gets.
        baud: The rate that it runs at.
    """
    from drivers.servos.setup import set_id as give

    servo = give(port, protocol, baud, old, new)
    print(f"{servo.model} {old} is now {servo.id}")
    return 0


def monitor(*, port: Port, rig: str = "puppet", seconds: float = float("inf"), rate: float = 10.0) -> int:
    """Show what the servos of a rig measure, live, with the torque as it is; Ctrl-C ends it. Nothing moves.

    Args:
        port: Serial port of the servo bus.
        rig: Name of the rig that is on the bus, or path of its folder.
        seconds: Stop after so long.
        rate: Readings a second.
    """
    from rich.live import Live

    from drivers.servos.connect import connect
    from drivers.signals import caught_signals

    body = load_rig(rig)
    began, reads = time.monotonic(), 0
    with caught_signals() as caught, connect(body, port) as bus, Live(console=show.console(), screen=False) as live:
        while not caught and (not reads or time.monotonic() - began < seconds):
            asked = time.monotonic()
            reading = bus.read()
            took = time.monotonic() - asked
            live.update(_readings(bus.joints, reading, f"{body.name} on {port}, read in {took * 1e3:.1f} ms"))
            reads += 1
            time.sleep(max(0.0, 1 / rate - took))
    return 0


def relax(*, port: Port, rig: str = "puppet") -> int:
    """Torque off for every servo of a rig, whatever else is wrong with the bus. Exit 1 where one did not confirm it.

    Args:
        port: Serial port of the servo bus.
        rig: Name of the rig that is on the bus, or path of its folder.
    """
    from drivers.servos.setup import relax as let_go

    left = let_go(load_rig(rig), port)
    print(f"not confirmed, cut the power: {', '.join(left)}" if left else "all limp")
    return 1 if left else 0


def calibrate(*, port: Port, rig: str = "puppet", joint: UseAppendAction[tuple[str, ...]] = ()) -> int:
    """Find zero and direction of each joint: torque off, you move it by hand, it is written to the rig's own file.

    Args:
        port: Serial port of the servo bus.
        rig: Name of the rig that is on the bus, or path of its folder.
        joint: Only these, by default all; the others keep what they have.
    """
    from drivers.calibration import save_marks
    from drivers.servos.calibrate import calibrate as find

    body = load_rig(rig)
    marks = find(body, port, joint or tuple(s.joint for s in body.servos), _ask)
    path = save_marks(body, marks)
    for name, mark in marks.items():
        print(f"{name}: direction {mark.direction:+d}, zero {mark.zero}")
    print(f"written to {path}")
    return 0


def log(file: Positional[Path], /, *, out: Path) -> int:
    """Write the log of a drive (`--record FILE`) as .csv: a row a cycle, of each joint what was commanded and measured.

    Args:
        file: A log (.rigrec).
        out: The table.
    """
    from drivers.recording import Recording
    from drivers.states import write_table

    print(f"wrote {out}: {write_table(Recording(file), out)} rows")
    return 0


def _ask(what: str) -> None:
    print(f"{what}, then press Enter", file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise ValueError("calibrate waits for Enter, and its input has ended")


def _readings(joints: tuple[str, ...], reading: Reading, title: str) -> Table:
    table = show.new_table("joint", "rad", "A", "°C", "V", title=title)
    columns = (reading.position, reading.current, reading.temperature, reading.voltage)
    formats = ("{:+.3f}", "{:+.3f}", "{:.0f}", "{:.1f}")
    for k, joint in enumerate(joints):
        table.add_row(joint, *(f.format(c[k]) if len(c) else "–" for f, c in zip(formats, columns, strict=True)))
    return table
