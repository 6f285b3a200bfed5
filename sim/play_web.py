"""A take on a page in the browser: the rig moves, a timeline, the report, plots, and a line to type where wanted."""

from __future__ import annotations

import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

from sim.findings import findings
from sim.preview import Preview
from sim.prompt_box import PromptBox, Say

PERIOD = 1 / 60  # s between two looks at the clock
BESIDE = 0.2  # s between two updates of slider and plots, which browsers draw slowly
WIDTH = 360  # pixels of the controls


def play_web(
    preview: Preview,
    *,
    say: Say | None = None,
    unchecked: bool = False,
    port: int = 8080,
    stop: threading.Event | None = None,
) -> None:
    """Show `preview` on a page on this machine alone, until `stop` is set or Ctrl-C.

    With `say` the page has a line to type: what is made of it takes the place of what is shown where its report passed,
    or `unchecked`. It is called in a thread of its own, once at a time. Prints the address on stderr, which ends in a
    token. Raises RuntimeError where the port is taken, and whatever `say` raises but for ValueError and RuntimeError.
    """
    from sim.guarded import guarded_server
    from sim.plots_panel import PlotsPanel
    from sim.timeline import Timeline
    from sim.view import drawn_on

    with ExitStack() as stack:
        server, address = stack.enter_context(guarded_server(port, f"rigcast: {preview.rig.name}"))
        show = drawn_on(server, preview.rig, preview.mount)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(WIDTH)
        box = None
        if say is not None:
            worker = stack.enter_context(ThreadPoolExecutor(1, thread_name_prefix="say"))
            box = PromptBox(server.gui, say, worker, unchecked=unchecked)
        timeline = Timeline(server.gui, preview)
        with server.gui.add_folder("Report"):
            report = server.gui.add_html(findings(preview))
        plots = PlotsPanel(server, preview)
        print(f"open {address} in a browser; Ctrl-C ends", file=sys.stderr, flush=True)
        shown, beside_at = -1, 0.0
        while not (stop and stop.is_set()):
            if box is not None and (made := box.poll()) is not None:
                preview, shown = made, -1
                timeline.load(preview)
                report.content = findings(preview)
                plots.load(preview)
            frame = timeline.player.frame
            if frame != shown:
                shown = frame
                show(preview.done[frame])
            if time.monotonic() >= beside_at:
                beside_at = time.monotonic() + BESIDE
                timeline.refresh()
                plots.refresh(frame)
            time.sleep(PERIOD)
