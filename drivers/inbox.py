"""What comes in from those who know neither our wire nor our keys, with the time at which it came.

A thread reads, so that times are right however long what came before takes to be dealt with.
"""

from __future__ import annotations

import errno
import re
import socket
import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

import zmq

from drivers.clock import Ticker
from drivers.endpoint import StreamError, endpoints
from drivers.keys import require_guarded
from drivers.messages import MAX_MESSAGE_BYTES
from drivers.sockets import open_socket
from drivers.sonic import TOPIC
from drivers.vmc import PORT

MOST = 512  # messages that wait; of more the oldest are lost
LOOK_UP_S = 0.05
MOST_DATAGRAM = 65_535
SILENT_NS = 1_000_000_000  # after which somebody else may speak
WAYS = f"vmc://:{PORT}, vmc://*:{PORT} or sonic://HOST:PORT"


@dataclass(frozen=True)
class Heard:
    """Bytes of one sender, and when they came."""

    at_ns: int
    sender: str
    data: bytes


Receive = Callable[[], tuple[str, bytes] | None]


class Inbox:
    """Hears `address`, see `opened`; a context manager. `refused` counts what was left out: `foreign` and `flood`."""

    def __init__(self, address: str, clock: Ticker, *, sender: str = "", insecure: bool = False) -> None:
        self._receive, self._close = opened(address, sender, insecure)
        self._clock, self._only = clock, sender
        self._speaker, self._spoke_ns = "", 0
        self._heard: deque[Heard] = deque()
        self._over = threading.Event()
        self.refused: Counter[str] = Counter()
        self.foreigner = ""
        self._thread = threading.Thread(target=self._read, name="inbox", daemon=True)
        self._thread.start()

    def take(self) -> list[Heard]:
        """All that came since the last call, in order."""
        return [self._heard.popleft() for _ in range(len(self._heard))]

    def close(self) -> None:
        """Hear no more."""
        self._over.set()
        self._thread.join()
        self._close()

    def __enter__(self) -> Inbox:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _read(self) -> None:
        while not self._over.is_set():
            if (found := self._receive()) is None:
                continue
            now, (sender, data) = self._clock.now_ns(), found
            if not self._may(sender, now):
                self.refused["foreign"] += 1
                self.foreigner = sender
                continue
            if len(self._heard) >= MOST:
                self._heard.popleft()
                self.refused["flood"] += 1
            self._heard.append(Heard(now, sender, data))

    def _may(self, sender: str, now: int) -> bool:
        """Whether it is the one who is allowed, and who speaks already or is the first after a silence."""
        if self._only and sender.rpartition(":")[0] != self._only:
            return False
        if sender != self._speaker and self._speaker and now - self._spoke_ns <= SILENT_NS:
            return False
        self._speaker, self._spoke_ns = sender, now
        return True


def opened(address: str, sender: str, insecure: bool) -> tuple[Receive, Callable[[], None]]:
    """What receives at `address`, within `LOOK_UP_S`, and what closes it: `vmc://[HOST]:PORT` listens for datagrams, on
    this machine alone where there is no host, on all of its addresses where that is `*`; `sonic://HOST:PORT` asks who
    publishes there.

    Raises StreamError where it is none of these, busy, or open to other machines with neither a `sender` nor
    `insecure`.
    """
    if match := re.fullmatch(r"vmc://(\*|[\w.-]*):(\d{1,5})", address):
        return _udp(address, match[1], int(match[2]), sender, insecure)
    if match := re.fullmatch(r"sonic://([\w.-]+):(\d{1,5})", address):
        return _subscribed(f"tcp://{match[1]}:{match[2]}", insecure)
    raise StreamError(f"source {address!r}: give {WAYS}")


def _udp(address: str, host: str, port: int, sender: str, insecure: bool) -> tuple[Receive, Callable[[], None]]:
    here = host or "127.0.0.1"
    if not (here == "localhost" or here.startswith("127.") or sender or insecure):
        raise StreamError(f"{address} hears other machines, and VMC knows no keys: say --sender IP, or --insecure")
    ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ear.settimeout(LOOK_UP_S)
    try:
        ear.bind(("" if host == "*" else here, port))
    except (OSError, OverflowError) as error:
        ear.close()
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            raise StreamError(f"{address} is busy: something else listens there; choose another port") from None
        raise StreamError(f"cannot listen on {address}: {error}") from None

    def receive() -> tuple[str, bytes] | None:
        try:
            data, (ip, from_port) = ear.recvfrom(MOST_DATAGRAM)
        except TimeoutError:
            return None
        return f"{ip}:{from_port}", data

    return receive, ear.close


def _subscribed(address: str, insecure: bool) -> tuple[Receive, Callable[[], None]]:
    require_guarded(endpoints(address), None, insecure)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        ear = open_socket(context, zmq.SUB, address, bind=False, max_bytes=MAX_MESSAGE_BYTES, queue=MOST)
    except BaseException:
        context.destroy(0)
        raise
    ear.setsockopt(zmq.UNSUBSCRIBE, b"")
    ear.setsockopt(zmq.SUBSCRIBE, TOPIC)

    def receive() -> tuple[str, bytes] | None:
        return (address, ear.recv()) if ear.poll(int(LOOK_UP_S * 1000)) else None

    return receive, lambda: context.destroy(0)
