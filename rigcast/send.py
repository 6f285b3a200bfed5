"""`rigcast send`: tell a service what the rig shall do now, and any stream to stop."""

from __future__ import annotations

import getpass
import json as json_text
import re
import secrets
import sys
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from drivers.endpoint import DEFAULT
from rigcast import show

if TYPE_CHECKING:
    from drivers.control import Answer, Look, Rest, Say, Status, Told
    from drivers.messages import Stop

SILENCE_S = 10.0
WELL = ("queued", "played", "resting", "stopped")
WAYS = "a TEXT, --idle, --stop or --status"


def send(
    text: Annotated[Positional[str | None], arg(metavar="TEXT")] = None,
    /,
    *,
    endpoint: Annotated[str, arg(metavar="ENDPOINT")] = DEFAULT,
    replace: bool = False,
    idle: bool = False,
    stop: bool = False,
    status: bool = False,
    seconds: float | None = None,
    seed: int = 0,
    guidance: float | None = None,
    no_wait: bool = False,
    leader: str = "",
    insecure: bool = False,
    json: bool = False,
) -> int:
    """Say what the rig of a service shall do, and wait until it was shown; exit 1 where it was not.

    Args:
        text: What the rig should do, in English, such as "wave with the right hand".
        endpoint: Where `rigcast serve` streams to.
        replace: Not after what waits and plays, but in place of it.
        idle: Instead of a text: forget what waits, and back to the idle motion.
        stop: Instead of a text: torque off, now; for every stream and every key. The service has to be started again.
        status: Instead of a text: how things stand.
        seconds: Length; by default what the generator finds natural.
        seed: The same seed gives the same motion.
        guidance: How strictly the text is followed; by default as the generator is best at.
        no_wait: Return once it is queued.
        leader: Name of the key that the service has (see `rigcast keys`); by default the only one that may lead.
        insecure: Speak to a service on another machine without keys.
        json: Print each answer as a line of JSON.
    """
    from drivers.caller import ControlLine
    from drivers.endpoint import StreamError, endpoints
    from drivers.keys import keys_for
    from drivers.signals import caught_signals

    if [text is not None, idle, stop, status].count(True) != 1:
        raise StreamError(f"say one thing: {WAYS}")
    request = _request(text, idle, stop, replace, seconds, seed, guidance)
    keys = keys_for(endpoints(endpoint), insecure=insecure, leader=leader)
    with ControlLine(endpoint, keys=keys, leader=leader, insecure=insecure) as line, caught_signals() as caught:
        line.ask(request)
        for answer in line.answers(lambda: bool(caught), SILENCE_S):
            _show(answer, json)
            if (code := _code(answer, no_wait)) is not None:
                return code
    return 130


def _request(
    text: str | None,
    idle: bool,
    stop: bool,
    replace: bool,
    seconds: float | None,
    seed: int,
    guidance: float | None,
) -> Say | Rest | Look | Stop:
    """Raises PromptError for a text or a length that no generator takes."""
    from drivers.control import Look, Rest, Say
    from drivers.messages import Stop
    from motiongen.generator import check_prompt

    id, who = secrets.token_hex(8), _who()
    if text is not None:
        return Say(id, check_prompt(text, seconds), seconds, seed, guidance, replace, who)
    if stop:
        return Stop(f"{who} said stop")
    return Rest(id, who) if idle else Look(id, who)


def _who() -> str:
    """This user's name, in the letters that a service takes; "somebody" where it has none."""
    try:
        return re.sub(r"[^\w.@-]", "_", getpass.getuser())[:64]
    except (KeyError, OSError):  # as in a container
        return "somebody"


def _code(answer: Answer, no_wait: bool) -> int | None:
    """The exit code with which this answer ends the conversation; None where more is to come."""
    from drivers.control import ENDS, Status

    if isinstance(answer, Status):
        return 0
    if answer.event in ENDS or (no_wait and answer.event == "queued"):
        return 0 if answer.event in WELL else 1
    return None


def _show(answer: Answer, json: bool) -> None:
    import msgspec

    from drivers.control import Status

    if json:
        print(json_text.dumps(msgspec.to_builtins(answer)), flush=True)
    elif isinstance(answer, Status):
        _show_status(answer)
    else:
        _show_told(answer)


def _show_told(told: Told) -> None:
    length = f", {told.seconds:.1f} s" if told.seconds else ""
    report = f", report {told.report_id}" if told.report_id else ""
    out = sys.stdout if told.event not in ("rejected", "refused", "dropped") else sys.stderr
    print(f"{told.event}{length}{report}" + (f": {told.detail}" if told.detail else ""), file=out, flush=True)


def _show_status(status: Status) -> None:
    what = f"{status.playing!r}, {status.left_s:.1f} s left" if status.playing else status.reason
    print(f"{status.rig} ({status.generator}): {status.mode}" + (f": {what}" if what else ""))
    print(f"waiting: {', '.join(map(repr, status.waiting)) or 'nothing'}; owner: {status.owner or 'nobody'}")
    if status.rigs:
        from rich.markup import escape

        table = show.new_table("rig", "key", "mode", "heard", "clock", title="rigs that follow")
        for rig in status.rigs:
            mode = f"{rig.mode}: {rig.reason}" if rig.reason else rig.mode
            clock = f"{rig.clock_s * 1e3:+.1f} ± {rig.clock_error_s * 1e3:.1f} ms" if rig.clock_error_s < 1e6 else "–"
            table.add_row(escape(rig.rig), rig.sender or "–", escape(mode), f"{rig.age_s:.1f} s ago", clock)
        show.console().print(table)
