"""The end of the line, shared by `say` and `play`: through the gate to files, the wire and a preview."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import UseAppendAction, arg

from rigcast import driving, show
from rigcast.pipeline import Take
from rigcast.times import BEGAN, Times

if TYPE_CHECKING:
    from drivers.drive import Driven
    from rigcast.saying import Saying
    from sim.preview import Preview
    from sim.prompt_box import Say

LISTENER_WAIT_S = 2.0  # a receiver that was there first comes back to a new publisher within half a second


@dataclass(frozen=True)
class Delivery:
    """Where a take goes."""

    out: Annotated[UseAppendAction[tuple[Path, ...]], arg(metavar="FILE")] = ()
    """Write by suffix: .npz .csv (trajectory), .motion.npz .bvh .glb .amass.npz .npy (human motion), .mp4 .gif .png,
    .json (report); docs/files.md has the rest."""
    publish: Annotated[str | None, arg(metavar="ENDPOINT")] = None
    """ZeroMQ endpoint to stream to, such as tcp://127.0.0.1:5555."""
    drive: Annotated[str | None, arg(metavar="PORT")] = None
    """Serial port of the rig's servo bus: the servos do it, here and now. "emulated" is a bus in this process that
    turns the rig's body in MuJoCo, "sim" servos without any load."""
    care: Annotated[driving.Driving, arg(name="")] = driving.Driving()  # noqa: RUF009
    rate: Annotated[float | None, arg(metavar="HZ")] = None
    """Frames a second on the wire, 1 to 1000; by default as many as were checked."""
    insecure: bool = False
    """Stream without encryption and to everybody, where other machines reach the endpoint."""
    view: Literal["native", "web", "none"] = "none"
    """Show it in a window or in the browser, until closed or Ctrl-C; after `say` the page takes more to say."""
    port: int = 8080
    """Port of the page in the browser, on 127.0.0.1."""
    fix: bool = True
    """Mend what the gate refuses: slower, on the feet that the rig has, balanced; the report says what was changed."""
    unchecked: bool = False
    """Go on where the report fails. A stream is then marked unchecked: previews follow it, nothing that moves does."""
    json: bool = False
    """Print one JSON document instead of tables."""


def require(how: Delivery, *, has_motion: bool) -> None:
    """Find out before any work what cannot be delivered, or must not be.

    Raises OutputError, ValueError, StreamError, BusError, ModuleNotFoundError, RuntimeError (no display, or the page's
    port is taken).
    """
    from rigcast.outputs import require_writable

    require_writable(how.out, has_motion=has_motion)
    if how.drive is not None:
        if how.unchecked:
            raise ValueError("--unchecked motion never reaches a servo: leave out --unchecked or --drive")
        driving.require_port(how.drive)
    if how.view == "native":
        from sim.window import require_display

        require_display()
    if how.view == "web":
        from sim.guarded import require_port

        require_port(how.port)
    if how.publish is not None:
        from drivers.endpoint import endpoints
        from drivers.keys import keys_for
        from drivers.publisher import require_free

        keys_for(endpoints(how.publish), insecure=how.insecure)
        require_free(how.publish)


def deliver(take: Take, how: Delivery, times: Times, said: dict[str, Any], saying: Saying | None = None) -> int:
    """Report, then write, stream and show `take` where it passed or `how.unchecked`; the exit code.

    `said` goes into the JSON document beside the take. With `saying` the page in the browser goes on taking texts.
    Raises OSError, StreamError, RuntimeError (no display).
    """
    if not how.json:
        console = show.console()
        console.print(show.size_line(take))
        console.print(show.origin_line(take), markup=False)
        console.print(show.report_table(take.report))
        for change in take.report.changes:
            print(f"mended: {change.text}")
    allowed = take.report.ok or how.unchecked
    done: dict[str, Any] = {"written": [], "published": None}
    driven = None
    if allowed:
        done = {"written": _write(take, how, times), "published": _publish(take, how, times)}
        driven = _drive(take, how, times)
    if how.json:
        moved = None if driven is None else driving.driven_dict(driven)
        show.print_json({**said, **show.take_dict(take), **done, "driven": moved, "seconds": times.seconds})
    else:
        for path in done["written"]:
            print(f"wrote {path}")
        if driven is not None:
            driving.print_driven(driven)
        print(show.times_line(times.seconds))
    if not allowed:
        show.warn("the report failed, so nothing was written or streamed; --unchecked writes and previews it anyway")
        return 1
    if how.view != "none":
        watch(take, how, saying)
    if done["published"] and done["published"]["ended"]:
        return 1
    return 0 if driven is None else driving.exit_code(driven)


def _write(take: Take, how: Delivery, times: Times) -> list[str]:
    from rigcast.outputs import suffix_of, write

    for path in how.out:
        with times.stage(f"write {suffix_of(path)}"):
            write(take, path)
    return [str(path) for path in how.out]


def _publish(take: Take, how: Delivery, times: Times) -> dict[str, Any] | None:
    if how.publish is None:
        return None
    from drivers.endpoint import endpoints
    from drivers.frame import UNCHECKED
    from drivers.keys import keys_for
    from drivers.publisher import publish

    report_id = UNCHECKED if how.unchecked else take.report.report_id
    keys = keys_for(endpoints(how.publish), insecure=how.insecure)
    with times.stage("stream"):
        sent = publish(
            take.trajectory,
            take.rig,
            report_id,
            how.publish,
            rate_hz=how.rate,
            wait_s=LISTENER_WAIT_S,
            keys=keys,
            insecure=how.insecure,
            controller=take.report.controller,
        )
    if not sent.heard:
        show.warn(f"nobody listened on {how.publish}; start `rigcast view` or `rigcast drive` first")
    if sent.ended:
        show.warn(f"the stream ended before its time: {sent.ended}")
    first_frame_s = sent.first_ns * 1e-9 - BEGAN
    facts = {k: v for k, v in asdict(sent).items() if k not in ("first_ns", "states")}
    return {"endpoint": how.publish, "report_id": report_id, "first_frame_s": first_frame_s, **facts}


def _drive(take: Take, how: Delivery, times: Times) -> Driven | None:
    if how.drive is None:
        return None
    from drivers.played import Played

    played = Played(take.trajectory, take.rig, take.report.report_id, controller=take.report.controller)
    with times.stage("drive"):
        return driving.run(take.rig, how.drive, played, how.care, lambda: "", take.rollout.mount)


def watch(take: Take, how: Delivery, saying: Saying | None) -> None:
    """Show what physics made of `take`, over and over, until the window closes or Ctrl-C.

    In the browser `saying` makes what is typed there.
    """
    from rigcast.outputs import preview_of

    preview = preview_of(take)
    with suppress(KeyboardInterrupt):
        if how.view == "native":
            from sim.play_native import play_native

            play_native(preview)
        else:
            from sim.play_web import play_web

            play_web(
                preview, say=None if saying is None else said_on_page(saying), unchecked=how.unchecked, port=how.port
            )


def said_on_page(saying: Saying) -> Say:
    """`saying`, as the page calls it."""
    from rigcast.outputs import preview_of

    def say(text: str, seed: int, tell: Callable[[str], None]) -> Preview:
        return preview_of(saying.say(text, seed, Times(), tell)[0])

    return say
