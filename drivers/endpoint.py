"""Endpoints: the five sockets of a stream derive from the one address that a person gives."""

from __future__ import annotations

import re
from dataclasses import dataclass

DEFAULT = "tcp://127.0.0.1:5555"


class StreamError(RuntimeError):
    """An endpoint that cannot be used, or a stream that does not fit the rig."""


@dataclass(frozen=True)
class Endpoints:
    """Addresses of the frames, hello, stop, state and control sockets. The publisher binds all five."""

    frames: str
    hello: str
    stop: str
    state: str
    control: str

    @property
    def local(self) -> bool:
        """Whether this machine's processes alone can reach them: an ipc path, or a loopback address."""
        return bool(re.match(r"ipc:|tcp://(127(\.\d{1,3}){3}|localhost|\[::1\]):", self.frames))


def endpoints(address: str) -> Endpoints:
    """The five addresses of `address`: `tcp://host:port` takes port to port + 4; `ipc://path` appends names.

    Raises StreamError where `address` is neither, or where port + 4 is no port.
    """
    if match := re.fullmatch(r"(tcp://(?:[\w.*-]+|\[[0-9a-fA-F:]+\])):(\d{1,5})", address):
        host, port = match[1], int(match[2])
        if not 1 <= port <= 65531:
            raise StreamError(f"port {port} in {address!r}: a stream takes five ports, from 1…65531")
        return Endpoints(*(f"{host}:{port + k}" for k in range(5)))
    if re.fullmatch(r"ipc://.+", address):
        return Endpoints(address, *(f"{address}.{name}" for name in ("hello", "stop", "state", "control")))
    raise StreamError(f"endpoint {address!r}: give tcp://host:port or ipc://path, such as {DEFAULT}")
