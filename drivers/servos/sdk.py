"""Scanning and ids of Dynamixel servos by the maker's own SDK, on real serial paths.

The SDK opens paths only and waits by asking over and over, so the cycle, and wires that are no path (TCP, in process),
have the codecs of this package. It is imported where it is used: a drive does without.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from drivers.servos.family import Family, Register
from drivers.servos.port import OPEN_ERRORS, PORT_ERRORS, Wire, lost, not_opened

if TYPE_CHECKING:
    from dynamixel_sdk import PortHandler

VERSIONS = {"dynamixel1": 1.0, "dynamixel2": 2.0}
PINGS = 2  # One lost byte hides nobody.


def has_sdk(wire: str | Wire, family: Family, baud: int) -> bool:
    """Whether the SDK can do it: a Dynamixel protocol on a serial path, at a rate that the SDK opens."""
    if family.name not in VERSIONS or not isinstance(wire, str) or "://" in wire:
        return False
    from dynamixel_sdk import PortHandler

    return bool(PortHandler(wire).getCFlagBaud(baud) == baud)


class SdkAsker:
    """An `Asker` (see `setup.py`) of the Dynamixel servos at the serial port `path`.

    Every method raises BusError where the port fails.
    """

    def __init__(self, path: str, family: Family, baud: int) -> None:
        from dynamixel_sdk import PacketHandler, PortHandler

        self._path, self._family, self._baud = path, family, baud
        self._port: PortHandler = PortHandler(path)
        self._packets = PacketHandler(VERSIONS[family.name])
        self._answer_together = family.name == "dynamixel2"

    def __enter__(self) -> SdkAsker:
        try:
            self._port.setBaudRate(self._baud)
            self._port.ser.exclusive = True
        except OPEN_ERRORS as error:
            self.__exit__()
            raise not_opened(self._path, self._baud, error) from None
        return self

    def __exit__(self, *_: object) -> None:
        if self._port.ser is not None:
            with contextlib.suppress(*PORT_ERRORS):
                self._port.closePort()

    def present(self, highest_id: int) -> Iterator[tuple[int, str]]:
        """Each id that answers and its model: of protocol 2.0 by broadcast pings, of 1.0 one id at a time."""
        if not self._answer_together:
            models = ((ident, self.model(ident)) for ident in range(highest_id + 1))
            yield from ((ident, model) for ident, model in models if model is not None)
            return
        found: dict[int, int] = {}
        for _ in range(PINGS):
            with self._lost():
                found |= {ident: number for ident, (number, _) in self._packets.broadcastPing(self._port)[0].items()}
        yield from sorted((i, self._family.model_name(number)) for i, number in found.items() if i <= highest_id)

    def model(self, ident: int) -> str | None:
        """The model that servo `ident` says that it is; None where nobody answers."""
        from dynamixel_sdk import COMM_SUCCESS

        for _ in range(PINGS):
            with self._lost():
                number, result, _ = self._packets.ping(self._port, ident)
            if result == COMM_SUCCESS:
                return self._family.model_name(number)
        return None

    def write(self, ident: int, register: Register, value: int) -> None:
        """Write a register of one byte; whether the servo took it is for the caller to ask."""
        with self._lost():
            self._packets.write1ByteTxRx(self._port, ident, register.address, value)

    @contextlib.contextmanager
    def _lost(self) -> Iterator[None]:
        try:
            yield
        except PORT_ERRORS as error:
            raise lost(self._path, error) from None
