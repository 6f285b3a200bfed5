"""What is seen of a training run: a bar or lines, a TensorBoard log, films of what the network draws."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from rigcast.show import warn

if TYPE_CHECKING:
    from rich.console import Console
    from tensorboardX import SummaryWriter

    from motiongen.diffusion.train import Log, Watch
    from motiongen.motion import Motion

RIG, FILM = "humanoid", (320, 240)
COUNTED = ("encoding captions", "joining motions", "encoding stretches")  # in the order of `Watch`


@contextmanager
def watching(folder: Path) -> Iterator[Watch]:
    """Callbacks that show the run in `folder`: on stderr, in `folder`/log and in `folder`/samples."""
    from rich.console import Console

    from motiongen.diffusion.train import Watch

    if os.environ.get("RANK", "0") != "0":  # of torchrun's processes the first alone shows anything
        yield Watch()
        return
    screen = Console(stderr=True)
    with ExitStack() as stack:
        (encoded, joined, coded), told = (
            _bars(stack, screen) if screen.is_terminal else ([_no_bar] * len(COUNTED), _print)
        )
        write = _tensorboard(stack, folder / "log")

        def logged(log: Log) -> None:
            told(log)
            write(log)

        drawn = _filmed(folder / "samples")
        yield Watch(lambda line: print(line, file=sys.stderr), encoded, joined, coded, logged, drawn)


def _no_bar(done: int, of: int) -> None:
    pass


def _print(log: Log) -> None:
    print(f"step {log.step}/{log.steps}  {_figures(log)}  {_time(log)}", file=sys.stderr, flush=True)


def _time(log: Log) -> str:
    return f"{log.pace:.2f} s/step, {log.left / 60:.0f} min left"


def _figures(log: Log) -> str:
    return "  ".join(f"{name} {value:.4f}" for name, value in log.terms.items())


Counted = Callable[[int, int], None]


def _bars(stack: ExitStack, screen: Console) -> tuple[list[Counted], Callable[[Log], None]]:
    """Bars for what is `COUNTED` and for the steps; each is there once it has something to tell."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[left]}"))
    bar = stack.enter_context(Progress(*columns, console=screen))
    tasks = {what: bar.add_task(what, visible=False, left="") for what in (*COUNTED, "training")}

    def counted(what: str, done: int, of: int) -> None:
        bar.update(tasks[what], completed=done, total=of, visible=done < of)

    def told(log: Log) -> None:
        bar.update(tasks["training"], completed=log.step, total=log.steps, visible=True, left=_time(log))
        bar.console.print(f"step {log.step}  {_figures(log)}", highlight=False)

    return [partial(counted, what) for what in COUNTED], told


def _tensorboard(stack: ExitStack, folder: Path) -> Callable[[Log], None]:
    """Writes each log for TensorBoard, where the package is there; the file is begun with the first one."""
    if find_spec("tensorboardX") is None:
        warn('no TensorBoard log is kept: pip install "rigcast[train]"')
        return lambda log: None
    writers: list[SummaryWriter] = []  # begun with the first log

    def write(log: Log) -> None:
        if not writers:
            from tensorboardX import SummaryWriter

            writers.append(SummaryWriter(str(folder)))
            stack.callback(writers[0].close)
        for name, value in {**log.terms, "rate": log.rate, "seconds a step": log.pace}.items():
            writers[0].add_scalar(name, value, log.step)

    return write


def _filmed(folder: Path) -> Callable[[int, list[Motion]], None] | None:
    """Films motions as step-000200-1.mp4 and so on; None where there is no MuJoCo."""
    if find_spec("mujoco") is None or find_spec("imageio_ffmpeg") is None:
        warn('no films are made on the way: pip install "rigcast[sim]"')
        return None

    def drawn(step: int, motions: list[Motion]) -> None:
        from retarget.retarget import retarget
        from retarget.rig import load_rig
        from sim.render import render_video

        folder.mkdir(exist_ok=True)
        rig = load_rig(RIG)
        try:
            for number, motion in enumerate(motions, start=1):
                trajectory = retarget(motion, rig, mount="free")
                path = folder / f"step-{step:06d}-{number}.mp4"
                title = motion.labels[0].text
                render_video(trajectory.qpos, trajectory.fps, rig, path, size=FILM, title=title, mount="free")
        except (RuntimeError, ValueError) as error:  # no OpenGL; or motion too wild to follow: training goes on
            warn(f"no film of step {step}: {error}")

    return drawn
