"""A maker as the service sees it: jobs in, what came of them out, and a new process where one has died."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import IO

import msgspec

from rigcast.service.making import Job, Made, Setup

MAKER = (sys.executable, "-m", "rigcast.service.maker")
PATIENCE_S = 180.0  # for one job, loading included
LEAVE_S = 2.0


class Workshop:
    """One maker process, one job at a time; never waits. Call `close` in the end."""

    def __init__(
        self, setup: Setup, command: Sequence[str] = MAKER, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._setup, self._command, self._now_s = setup, tuple(command), now_s
        self._process: subprocess.Popen[bytes] | None = None
        self._lines: SimpleQueue[bytes] = SimpleQueue()
        self._job = 0
        self._asked_s = 0.0
        self.starts = 0
        self.busy = True  # with the setup
        self._start()

    def ask(self, job: Job) -> None:
        """Begin with `job`. Raises RuntimeError where another one is not done."""
        if self.busy:
            raise RuntimeError(f"job {job.number} while job {self._job} is not done")
        if self._process is None:
            self._start()
        self.busy, self._job, self._asked_s = True, job.number, self._now_s()
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError):  # it has just died; `done` will say so
                self._process.stdin.write(msgspec.json.encode(job) + b"\n")

    def done(self) -> Made | None:
        """What came of the job, once: also where the process died on it or took longer than `PATIENCE_S`."""
        if self._process is None:
            return None
        if self.busy and self._now_s() - self._asked_s > PATIENCE_S:
            return self._failed(f"it took more than {PATIENCE_S:g} s")
        try:
            line = self._lines.get_nowait()
        except Empty:
            return None
        if not line:
            code = self._end()
            return self._failed(f"the process that makes motions ended with {code}") if self.busy else None
        made = msgspec.json.decode(line, type=Made)
        if made.number != self._job:  # the setup's answer, of a process that was started for a job
            return None
        self.busy = False
        return made

    def close(self) -> None:
        """End the process, by its leave or without."""
        if self._process is not None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(LEAVE_S)
            self._end()

    def _failed(self, why: str) -> Made:
        if self._process is not None:
            self._end()
        self.busy = False
        return Made(self._job, ok=False, detail=why)

    def _start(self) -> None:
        pipe = subprocess.PIPE
        # A group of its own: Ctrl-C is for the service, which then ends the maker.
        group = 0 if os.name == "posix" else None
        self._process = subprocess.Popen(self._command, stdin=pipe, stdout=pipe, bufsize=0, process_group=group)
        self._lines, self._asked_s = SimpleQueue(), self._now_s()
        self.starts += 1
        stdin, stdout = self._process.stdin, self._process.stdout
        if stdin is None or stdout is None:
            raise RuntimeError("a maker without pipes")
        stdin.write(msgspec.json.encode(self._setup) + b"\n")
        threading.Thread(target=_read, args=(stdout, self._lines), name="maker", daemon=True).start()

    def _end(self) -> int:
        """Its exit code; it is killed where it still runs, since nobody may wait for it here."""
        process, self._process = self._process, None
        if process is None:
            return 0
        if process.stdin is not None:
            process.stdin.close()
        process.kill()
        return process.wait()


def _read(stdout: IO[bytes], lines: SimpleQueue[bytes]) -> None:
    with stdout:
        while line := stdout.readline():
            lines.put(line)
    lines.put(b"")
