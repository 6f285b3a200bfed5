"""The guard: a process that owns a rig's serial port, and switches the rig off where its driver dies or falls silent.

    python -m drivers.servos.guard_process < orders

It knows nothing of servos: the driver's bytes go to the port as they come, the port's bytes go back. When the driver's
connection ends in whatever way, `kill -9` included, or is silent for too long, it sends the bytes that switch all off,
several times. What it is to do comes as one JSON line, `Orders`.
"""

from __future__ import annotations

import contextlib
import hmac
import json
import signal
import socket
import sys
import threading
import time
from dataclasses import asdict, dataclass

from drivers.servos.port import OPEN_ERRORS, PORT_ERRORS, Serial, SerialWire, not_opened

TIMES, APART_S = 5, 0.02  # A packet may be cut short by the death, another by noise: one of five gets through.
CONNECT_S = 10.0
SLICE_S = 0.02
CHUNK = 4096
READY = "ready "


@dataclass(frozen=True)
class Orders:
    """The serial port and its rate; `off`: hexadecimal bytes that switch all off; `silence_s`: of the driver, at most,
    None without end; `token`: what the driver says first, since any program may connect."""

    path: str
    baud: int
    off: str
    silence_s: float | None
    token: str

    def line(self) -> str:
        """As JSON."""
        return json.dumps(asdict(self)) + "\n"


def main() -> int:
    """Take the orders from stdin, say READY and the local TCP port on stdout, then guard until the driver is gone.

    Exit 1, with what is wrong on stdout, where the serial port cannot be opened.
    """
    orders = Orders(**json.loads(sys.stdin.readline()))
    for name in ("SIGINT", "SIGHUP"):  # meant for the driver, which ends in order
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    try:
        port = SerialWire(orders.path).open(orders.baud, SLICE_S)
    except OPEN_ERRORS as error:
        print(not_opened(orders.path, orders.baud, error), flush=True)
        return 1
    with contextlib.closing(port), socket.create_server(("127.0.0.1", 0)) as server:
        print(f"{READY}{server.getsockname()[1]}", flush=True)
        with contextlib.closing(_driver(server, orders.token)) as driver:
            cause, told = _guard(driver, port, orders)
        if cause or not told:
            _complain(cause or "the driver is gone", told)
    return 0


def _driver(server: socket.socket, token: str) -> socket.socket:
    server.settimeout(CONNECT_S)
    while True:
        connection, _ = server.accept()
        connection.settimeout(CONNECT_S)
        said = b""
        while len(said) < len(token) and (more := connection.recv(len(token) - len(said))):
            said += more
        if hmac.compare_digest(said, token.encode()):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return connection
        connection.close()


def _guard(driver: socket.socket, port: Serial, orders: Orders) -> tuple[str, bool]:
    """Pass bytes on until the driver's connection ends, then switch off; why it was ended from this side, "" where it
    was not, and whether the port took the bytes.
    """
    lost: list[str] = []
    ended = threading.Event()
    back = threading.Thread(target=_answers, args=(driver, port, ended, lost), daemon=True)
    back.start()
    try:
        cause = _relay(driver, port, orders.silence_s)
    finally:  # From here on nothing of the driver's is passed on: it cannot switch anything on again.
        told = _switch_off(port, bytes.fromhex(orders.off))
        ended.set()
        back.join()
    return lost[0] if lost else cause, told


def _relay(driver: socket.socket, port: Serial, silence_s: float | None) -> str:
    """Pass the driver's bytes on until it is gone or falls silent; what was wrong, "" where it is just gone."""
    driver.settimeout(silence_s)
    try:
        while data := driver.recv(CHUNK):
            port.write(data)
    except TimeoutError:
        return f"the driver said nothing for {silence_s} s"
    except ConnectionError:
        return ""
    except PORT_ERRORS as error:
        return f"the port is lost: {error}"
    return ""


def _answers(driver: socket.socket, port: Serial, ended: threading.Event, lost: list[str]) -> None:
    while not ended.is_set():
        try:
            data = port.read(1)
            if data:
                data += port.read(getattr(port, "in_waiting", 0))
        except PORT_ERRORS as error:
            lost.append(f"the port is lost: {error}")
            break
        try:
            if data:
                driver.sendall(data)
        except OSError:
            break  # The driver is gone: the other direction sees it too.
    with contextlib.suppress(OSError):
        driver.shutdown(socket.SHUT_RDWR)


def _switch_off(port: Serial, off: bytes) -> bool:
    """Whether the port took the bytes."""
    with contextlib.suppress(*PORT_ERRORS):
        for _ in range(TIMES):
            port.write(off)
            time.sleep(APART_S)
        return True
    return False


def _complain(cause: str, told: bool) -> None:
    end = "told all servos to let go" if told else "no servo can be reached, cut the power"
    with contextlib.suppress(OSError):  # The terminal may have gone with the driver.
        print(f"rigcast guard: {cause}: {end}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
