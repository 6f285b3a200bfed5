"""`rigcast keys`: the key pair of this machine, and what the keys of others may do."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

from drivers.keys import OWN, RIGHTS, Right
from rigcast import show


def new() -> int:
    """Make the key pair of this machine and print its public key, which others have to allow."""
    from drivers.keys import new_keys

    print(new_keys().public.hex())
    return 0


def listing(*, json: bool = False) -> int:
    """This machine's public key, and what the keys of other machines may do.

    Args:
        json: Print one JSON document instead of a table.
    """
    from drivers.keys import load_keys

    keys = load_keys()
    rows = [(OWN, RIGHTS, keys.public.hex()), *((name, p.may, p.key) for name, p in keys.peers.items())]
    if json:
        show.print_json([{"name": name, "may": may, "key": key} for name, may, key in rows])
        return 0
    table = show.new_table("name", "may", "public key")
    for name, may, key in rows:
        table.add_row(name, " ".join(may), key)
    show.console().print(table)
    return 0


def allow(
    name: Annotated[Positional[str], arg(metavar="NAME")],
    key: Annotated[Positional[str], arg(metavar="KEY")],
    /,
    *,
    may: Annotated[UseAppendAction[tuple[Right, ...]], arg(metavar="RIGHT")] = (),
) -> int:
    """Let the machine with the public KEY do what is said, under NAME; what NAME was before is replaced.

    Args:
        name: What to call it here.
        key: Its public key, as `rigcast keys new` printed it there.
        may: follow (receive our streams), control (send to us) or lead (our rigs follow it); may be given many times.
    """
    from drivers.keys import allow as run

    print(f"{name} may {' '.join(run(name, key, may).peers[name].may)}")
    return 0


def forget(name: Annotated[Positional[str], arg(metavar="NAME")], /) -> int:
    """Allow the machine NAME nothing any more; streams that run now keep it until they start again.

    Args:
        name: What it is called here.
    """
    from drivers.keys import forget as run

    run(name)
    return 0
