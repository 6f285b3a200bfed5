"""A link that loses, delays, re-orders, doubles and damages frames, as the kernel's netem would packets."""

from __future__ import annotations

import heapq
import itertools
import random
import threading
import time

import zmq

from drivers.endpoint import endpoints


class BadLink:
    """Passes the frames of the stream at `source` on at `address`; a context manager. Set the attributes as it runs.

    `drop`, `double` and `flip` are the chances of each for a frame; each waits `delay_s`, and up to `spread_s` more.
    """

    def __init__(self, source: str, address: str, seed: int = 1) -> None:
        self.drop = self.double = self.flip = self.delay_s = self.spread_s = 0.0
        self._random = random.Random(seed)
        self._stopped = threading.Event()
        self._context = zmq.Context()
        self._in = self._context.socket(zmq.SUB)
        self._in.subscribe(b"")
        self._in.setsockopt(zmq.RECONNECT_IVL_MAX, 100)
        self._in.connect(endpoints(source).frames)
        self._out = self._context.socket(zmq.PUB)
        self._out.bind(endpoints(address).frames)
        self._thread = threading.Thread(target=self._work)

    def __enter__(self) -> BadLink:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()
        self._context.destroy(0)

    def _work(self) -> None:
        waiting: list[tuple[float, int, bytes]] = []
        count = itertools.count()
        while not self._stopped.is_set():
            if self._in.poll(2):
                data = self._in.recv()
                copies = 0 if self._chance(self.drop) else 2 if self._chance(self.double) else 1
                for _ in range(copies):
                    late = self.delay_s + self.spread_s * self._random.random()
                    heapq.heappush(waiting, (time.monotonic() + late, next(count), self._maybe_damaged(data)))
            while waiting and waiting[0][0] <= time.monotonic():
                self._out.send(heapq.heappop(waiting)[2])

    def _chance(self, of: float) -> bool:
        return self._random.random() < of

    def _maybe_damaged(self, data: bytes) -> bytes:
        if not self._chance(self.flip):
            return data
        changed = bytearray(data)
        for _ in range(self._random.randint(1, 5)):
            bit = self._random.randrange(8 * len(data))
            changed[bit // 8] ^= 1 << bit % 8
        return bytes(changed)
