"""A TCP connection with somebody in between, who keeps every byte."""

from __future__ import annotations

import contextlib
import socket
import threading


class Tap:
    """Forwards 127.0.0.1:`port` to `target`. `heard[k]`: what client k sent, `told[k]`: what it was sent, in chunks.

    `say(k, data)` puts bytes into what the server hears from client k.
    """

    def __init__(self, target: int) -> None:
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.heard: list[list[bytes]] = []
        self.told: list[list[bytes]] = []
        self._ends: list[tuple[socket.socket, socket.socket]] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def say(self, client: int, data: bytes) -> None:
        self._ends[client][1].sendall(data)

    def close(self) -> None:
        self._listener.close()
        for end in (e for pair in self._ends for e in pair):
            end.close()

    def __enter__(self) -> Tap:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
                server = socket.create_connection(("127.0.0.1", self._target))
            except OSError:
                return
            heard, told = [], []
            self.heard.append(heard)
            self.told.append(told)
            self._ends.append((client, server))
            for source, sink, kept in ((client, server, heard), (server, client, told)):
                threading.Thread(target=self._pump, args=(source, sink, kept), daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket, kept: list[bytes]) -> None:
        try:
            while data := source.recv(65536):
                kept.append(data)
                sink.sendall(data)
        except OSError:
            pass
        finally:
            for end in (source, sink):
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
