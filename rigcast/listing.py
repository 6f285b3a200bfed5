"""`rigcast rigs` and `rigcast generators`: what is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from motiongen.generator import list_generators
from retarget.rig import Rig, list_rigs, load_rig
from rigcast import show


def rigs(*, json: bool = False) -> int:
    """List the rigs: built in, and in the folders that RIGCAST_RIGS names.

    Args:
        json: Print one JSON document instead of a table.
    """
    return _print([_rig_row(load_rig(name)) for name in list_rigs()], json)


def _rig_row(rig: Rig) -> dict[str, object]:
    return {
        "name": rig.name,
        "joints": len(rig.joints),
        "servos": len(rig.servos),
        "mount": rig.mount,
        "where the computer dies": failsafe(rig),
        "folder": str(rig.folder),
    }


def failsafe(rig: Rig) -> str:
    """What the servos of `rig` do by themselves when nobody talks to them any more."""
    from drivers.servos.table import FAMILIES

    if not rig.servos:
        return "no servos"
    watched = all(b.protocol in FAMILIES and FAMILIES[b.protocol].watchdog_s for b in rig.buses)
    return "servos stop, keep torque" if watched else "no hardware failsafe: fit a power switch"


def generators(*, json: bool = False) -> int:
    """List the generators of motion.

    Args:
        json: Print one JSON document instead of a table.
    """
    return _print([{"name": name, "what": what} for name, what in list_generators().items()], json)


def _print(rows: Sequence[Mapping[str, object]], json: bool) -> int:
    if json:
        show.print_json(rows)
        return 0
    table = show.new_table(*(rows[0] if rows else ("none",)))
    for row in rows:
        table.add_row(*map(str, row.values()))
    show.console().print(table)
    return 0
