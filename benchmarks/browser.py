"""A page in a real browser without a screen: Chromium, told what to do by the DevTools protocol."""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from websockets.sync.client import ClientConnection, connect

PATIENCE = 60.0  # s; software drawing takes a while
CLOSING = 10.0  # s to go by itself
LARGEST = 64 * 2**20  # bytes of a message: a picture


def chromium() -> str | None:
    """The browser on this machine, or the one that CHROMIUM names."""
    return os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")


class Tab:
    """A tab, and the page in it."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._calls = socket, 0

    def call(self, method: str, **params: object) -> dict[str, Any]:
        """What the browser answers to a method of the protocol. Raises RuntimeError where it refuses."""
        self._calls += 1
        self._socket.send(json.dumps({"id": self._calls, "method": method, "params": params}))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE))
            if answer.get("id") == self._calls:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]

    def open(self, address: str) -> None:
        self.call("Page.navigate", url=address)

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page, as JSON has it. Raises RuntimeError where it throws."""
        result = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        if "exceptionDetails" in result:
            raise RuntimeError(result["exceptionDetails"].get("exception", {}).get("description", script))
        return result["result"].get("value")

    def wait(self, words: str, patience: float = PATIENCE) -> None:
        """Until the page says `words`. Raises TimeoutError with what it says instead."""
        deadline = time.monotonic() + patience
        while words not in (said := self.text()):
            if time.monotonic() > deadline:
                raise TimeoutError(f"the page does not say {words!r}, but {said[-400:]!r}")
            time.sleep(0.1)

    def text(self) -> str:
        """All words of the page."""
        return str(self.evaluate("document.body ? document.body.innerText : ''"))

    def click(self, script: str) -> None:
        """Press the mouse in the middle of the element that an expression gives."""
        x, y, width, height = self.evaluate(
            f"(({{x, y, width, height}}) => [x, y, width, height])({script}.getBoundingClientRect())"
        )
        x, y = x + width / 2, y + height / 2
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def type(self, text: str) -> None:
        """Put `text` where the cursor is."""
        self.call("Input.insertText", text=text)

    def press(self, key: str, code: int) -> None:
        """Press and let go a key, by its name and Windows code: Enter is 13."""
        held = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        self.call("Input.dispatchKeyEvent", type="keyDown", text="\r" if key == "Enter" else "", **held)
        self.call("Input.dispatchKeyEvent", type="keyUp", **held)

    def picture(self, *, whole: bool = False) -> Image.Image:
        """What is seen, or the `whole` of a page that is longer."""
        data = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"]
        return Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")


@contextmanager
def browser(program: str, size: tuple[int, int] = (1280, 800)) -> Iterator[Tab]:
    """A tab of `size` pixels in Chromium, drawn in software. Raises RuntimeError where it does not start."""
    flags = ["--headless=new", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    flags += ["--remote-debugging-port=0", "--hide-scrollbars", f"--window-size={size[0]},{size[1]}"]
    if os.geteuid() == 0:
        flags.append("--no-sandbox")  # Chromium has none for root
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as room,
        subprocess.Popen(
            [program, *flags, f"--user-data-dir={room}", "about:blank"], stderr=subprocess.DEVNULL
        ) as process,
    ):
        try:
            with connect(_address(Path(room)), max_size=LARGEST, proxy=None) as socket:
                tab = Tab(socket)
                width, height = size
                tab.call(
                    "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
                )
                yield tab
        finally:
            process.terminate()
            try:
                process.wait(CLOSING)
            except subprocess.TimeoutExpired:  # it may not listen while it draws
                process.kill()


def _address(room: Path) -> str:
    """Where the first tab of a browser that has just been started in `room` is told what to do."""
    told, deadline = room / "DevToolsActivePort", time.monotonic() + PATIENCE
    while not (told.exists() and "\n" in told.read_text()):
        if time.monotonic() > deadline:
            raise RuntimeError(f"the browser did not start within {PATIENCE:g} s")
        time.sleep(0.05)
    with urllib.request.urlopen(f"http://127.0.0.1:{told.read_text().split()[0]}/json/list") as answer:
        return str(next(t["webSocketDebuggerUrl"] for t in json.load(answer) if t["type"] == "page"))
