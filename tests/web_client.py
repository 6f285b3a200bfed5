"""What a browser is to a viser server, without a browser: reads the controls of a page and uses them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec.msgpack
import viser
import zstandard
from websockets.sync.client import ClientConnection, connect

CAMERA = {
    "type": "ViewerCameraMessage",  # a client is there once it has a camera
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 0.0, 0.0),
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 10.0,
    "image_height": 10,
    "image_width": 10,
}


class WebClient:
    """`controls`: by their ids what the page has; all that a message of viser's says of one, flat."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self.controls = socket, {}
        self._send(CAMERA)

    def wait(self, what: Callable[[WebClient], Any], patience: float = 20.0) -> Any:
        """What `what` gives, once it is true."""
        deadline = time.monotonic() + patience
        while not (value := what(self)):
            assert time.monotonic() < deadline, self.words()
            self._read()
        return value

    def words(self) -> str:
        """All HTML of the page."""
        return " ".join(str(c["content"]) for c in self.controls.values() if "content" in c)

    def one(self, label: str, kind: str = "") -> dict[str, Any]:
        """The control with that label, and of that kind where several have it."""
        return next(c for c in self.controls.values() if c.get("label") == label and kind in c["type"])

    def set(self, label: str, value: object) -> None:
        """Give a control a value, or click a button: its value is True."""
        self._send({"type": "GuiUpdateMessage", "uuid": self.one(label)["uuid"], "updates": {"value": value}})

    def submit(self, label: str) -> None:
        """Send off a form."""
        self._send({"type": "GuiFormSubmitMessage", "uuid": self.one(label, "Form")["uuid"]})

    def _send(self, message: dict[str, Any]) -> None:
        self._socket.send(msgspec.msgpack.encode(message))

    def _read(self) -> None:
        try:
            data = self._socket.recv(timeout=0.2)
        except TimeoutError:
            return
        packed = data[16 : 16 + int.from_bytes(data[8:16], "little")]
        for message in msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed))["messages"]:
            if message["type"] == "GuiUpdateMessage":
                self.controls[message["uuid"]].update(message["updates"])
            elif message["type"].startswith("Gui") and "props" in message:
                self.controls[message["uuid"]] = {**message.pop("props"), **message}


@contextmanager
def web_client(address: str) -> Iterator[WebClient]:
    """A client of the page at `address`."""
    protocol = f"viser-v{viser.__version__}"
    with connect(
        address.rstrip("/").replace("http:", "ws:"), subprotocols=[protocol], proxy=None, max_size=2**26
    ) as socket:
        yield WebClient(socket)
