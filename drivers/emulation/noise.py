"""Damage on a line: bytes that go missing, change or come twice."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random


@dataclass(frozen=True)
class Noise:
    """Chance of each byte to be dropped, corrupted (any byte in its place) or doubled; `late_s` is added to answers.

    `down` and `up`: whether it hurts what the host sends and what it hears.
    """

    drop: float = 0.0
    corrupt: float = 0.0
    double: float = 0.0
    late_s: float = 0.0
    down: bool = True
    up: bool = True


def hurt(data: bytes, noise: Noise, random: Random) -> bytes:
    """`data` as it comes out at the other end."""
    if not (noise.drop or noise.corrupt or noise.double):
        return data
    out = bytearray()
    for byte in data:
        if random.random() < noise.drop:
            continue
        if random.random() < noise.corrupt:
            byte = random.randrange(256)
        out.append(byte)
        if random.random() < noise.double:
            out.append(byte)
    return bytes(out)
