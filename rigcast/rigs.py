"""`rigcast rigs new`, `check` and `draw`: a robot's model made a rig, what a rig can do, and how rigs look doing it."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

from retarget.rig import load_rig
from retarget.shown import cannot_show
from rigcast import show

RANGE_OF_MOTION = (
    "t-pose", "raise-arm", "arms-forward", "wave", "clap", "hands-on-hips", "nod", "look-around", "bow", "twist",
    "squat", "march", "kick", "step-forward", "sidestep", "turn",
)  # fmt: skip


@dataclass(frozen=True)
class OnBus:
    """Of a puppet without a model."""

    from_bus: Annotated[str | None, arg(metavar="PORT")] = None
    """In place of MODEL: move each servo on this port and ask what it turns; a model of capsules is made of that."""
    answers: Annotated[Path | None, arg(metavar="FILE")] = None
    """With --from-bus: ask and move nothing, all is told here (docs/rigs.md); each such session leaves answers.toml."""
    protocol: UseAppendAction[tuple[str, ...]] = ()
    """With --from-bus: look for these only; dynamixel2, dynamixel1, feetech, lx16a."""
    baud: UseAppendAction[tuple[int, ...]] = ()
    """With --from-bus: only at these rates."""
    highest_id: int = 252
    """With --from-bus: ask ids from 0 to this one."""


def new(
    model: Positional[Path | None] = None,
    /,
    *,
    on_bus: Annotated[OnBus, arg(name="")] = OnBus(),
    out: Path | None = None,
    gmr: Path | None = None,
    limit: float | None = None,
    picture: bool = True,
) -> int:
    """Propose a rig.toml for MODEL (.xml or .urdf), say what was guessed, and draw it beside a human in a T-pose.

    Args:
        out: Folder of the new rig; by default one beside where you are, named as the model, or "puppet-of-mine".
        gmr: An ik_config of GMR that says which body follows which human joint.
        limit: Limit in rad, to both sides, for joints without one.
        picture: Draw t_pose.png into the folder.
    """
    from retarget.adopt import adopt, new_rig_file

    if (model is None) == (on_bus.from_bus is None):
        raise ValueError("give a MODEL, or --from-bus PORT for a puppet that has none")
    if on_bus.from_bus is not None and (gmr is not None or limit is not None):
        raise ValueError("--gmr and --limit are for a MODEL")
    if on_bus.from_bus is None and on_bus != OnBus():
        raise ValueError("--answers, --protocol, --baud and --highest-id go with --from-bus")
    folder = out or Path("puppet-of-mine" if model is None else model.stem)
    new_rig_file(folder)
    guesses = adopt(model, folder, gmr=gmr, limit=limit) if model is not None else _from_bus(on_bus, folder)
    for guess in guesses:
        print(f"guessed: {guess}")
    print(f"wrote {folder / 'rig.toml'}")
    if picture:
        from motiongen.gestures.catalogue import perform
        from sim.side_by_side import render_side_by_side

        pair = (load_rig(folder.resolve()), load_rig("humanoid"))
        render_side_by_side(pair, perform("t-pose"), folder / "t_pose.png", size=(480, 480))
        print(f"wrote {folder / 't_pose.png'}")
    if on_bus.from_bus is not None:
        on = f"--port {on_bus.from_bus} --rig {folder}"
        print(f"next: rigcast rigs check {folder}; rigcast bus calibrate {on}; rigcast bus wiggle {on}")
    return 0


def _from_bus(how: OnBus, folder: Path) -> tuple[str, ...]:
    """The guesses in the rig that was made of the servos on a bus."""
    from drivers.servos.newcomers import show as move
    from drivers.servos.newcomers import stranger
    from retarget.adopt import adopt_puppet
    from rigcast import from_bus

    port = how.from_bus or ""
    found = from_bus.found_on(port, how.protocol, how.baud, how.highest_id)
    rig = stranger(found)
    if how.answers is not None:
        return adopt_puppet(from_bus.told_by(how.answers, found), folder)
    print(from_bus.START, file=sys.stderr)
    return adopt_puppet(from_bus.described(found, lambda ident: move(rig, port, ident), from_bus.asked), folder)


def check(name: Positional[str], /, *, model: Path | None = None, json: bool = False) -> int:
    """Put a rig through a range of motion; exit 0 where physics passes all of it, 1 where it does not.

    Args:
        name: Name of a rig (see `rigcast rigs`) or path of its folder.
        model: The rig's MJCF, where it is not where the rig looks for it.
        json: Print one JSON document instead of a table.
    """
    from motiongen.gestures.catalogue import perform
    from retarget.retarget import retarget
    from sim.checks import check as judged

    rig = load_rig(name, model)
    rows = []
    for gesture in RANGE_OF_MOTION:
        motion = perform(gesture)
        report = judged(retarget(motion, rig), rig)
        failed = [c.name for c in report.checks if not c.ok]
        hidden = [note.split(" has ")[1].split(":")[0] for note in cannot_show(motion, rig)]
        rows.append({"gesture": gesture, "ok": report.ok, "failed": ", ".join(failed), "not shown": ", ".join(hidden)})
    if json:
        show.print_json({"rig": rig.name, "gestures": rows})
    else:
        table = show.new_table("gesture", "", "failed", "not shown", title=f"{rig.name}: range of motion")
        for row in rows:
            verdict = "[green]pass[/]" if row["ok"] else "[red]fail[/]"
            table.add_row(str(row["gesture"]), verdict, str(row["failed"]), str(row["not shown"]))
        show.console().print(table)
    return 0 if all(row["ok"] for row in rows) else 1


def draw(names: Positional[tuple[str, ...]], /, *, out: Path, gesture: str = "wave", at: float = 0.5) -> int:
    """Draw rigs beside each other, all doing the same gesture, into a .png.

    Args:
        names: Names of rigs (see `rigcast rigs`) or paths of their folders.
        out: The picture.
        gesture: What they do; see docs/gestures.md.
        at: When to look: 0 is the start, 1 the end.
    """
    from motiongen.gestures.catalogue import perform
    from sim.side_by_side import render_side_by_side

    render_side_by_side([load_rig(name) for name in names], perform(gesture), out, at=at)
    print(f"wrote {out}")
    return 0
