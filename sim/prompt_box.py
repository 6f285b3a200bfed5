"""The line to type on the page: one prompt at a time, worked at beside the page, which goes on meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from html import escape
from typing import TYPE_CHECKING

from sim.findings import FAIL, QUIET, boxed, faults
from sim.preview import Preview

if TYPE_CHECKING:
    import viser

Say = Callable[[str, int, Callable[[str], None]], Preview]
"""Makes a preview of a text and a seed, and tells what whoever typed should read; raises ValueError or RuntimeError,
in words for them, where there is none."""


class PromptBox:
    """A form for a text and a seed. What passed comes out of `poll`; why another did not stands under the form.

    `unchecked`: what fails the report comes out too.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        say: Say,
        worker: Executor,
        *,
        unchecked: bool,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._say, self._worker, self._unchecked, self._clock = say, worker, unchecked, clock
        self._lock = threading.Lock()
        self._work: Future[Preview] | None = None
        self._told: list[str] = []
        self._shown = ""
        with gui.add_form("Say it") as form:
            self._text = gui.add_text("do", "", hint='in English, such as "wave with the right hand"; Enter says it')
            self._seed = gui.add_number("seed", 0, min=0, step=1, hint="another one gives another motion")
            self._button = gui.add_button("Say it")
        self._status = gui.add_html("")
        self._button.on_click(lambda _: self._submit())
        form.on_submit(lambda _: self._submit())

    def poll(self) -> Preview | None:
        """The motion that was said and made since the last call, where it may be shown. Never waits."""
        work = self._work
        if work is None:
            return None
        if not work.done():
            self._show(f"<p>at work on{self._about} … {int(self._clock() - self._began)} s</p>")
            return None
        made = self._outcome(work)
        with self._lock:
            self._work = None
            self._set_busy(False)
        return made

    def _submit(self) -> None:
        """Begin with what stands in the form, unless another prompt is at work. In a thread of the server's."""
        with self._lock:
            if self._work is not None:
                return
            text, seed = self._text.value, self._seed.value
            self._about, self._began = f" <b>{escape(text.strip())}</b>" if text.strip() else "", self._clock()
            self._told = []
            self._work = self._worker.submit(self._say, text, seed, self._told.append)
            self._set_busy(True)

    def _outcome(self, work: Future[Preview]) -> Preview | None:
        try:
            made = work.result()
        except (ValueError, RuntimeError) as why:
            self._refuse(escape(" ".join(str(why).split())))
            return None
        if not made.report.ok and not self._unchecked:
            self._refuse(f"physics says no.{faults(made.report)}")
            return None
        self._show(f"<p>done{self._about}: {self._clock() - self._began:.1f} s</p>")
        return made

    def _refuse(self, why: str) -> None:
        self._show(f'<p><b style="color:{FAIL}">not done</b>{self._about}: {why}</p>')

    def _show(self, html: str) -> None:
        notes = "".join(f'<p style="color:{QUIET}">{escape(line)}</p>' for line in list(self._told))
        if (text := boxed(html + notes)) != self._shown:
            self._shown = self._status.content = text

    def _set_busy(self, busy: bool) -> None:
        self._text.disabled = self._seed.disabled = self._button.disabled = busy
