"""Datagrams gone wrong: bytes changed, cut, put in, or drawn at random, with a seed."""

from __future__ import annotations

import random
from collections.abc import Iterator


def spoilt(data: bytes, count: int, seed: int, alphabet: bytes) -> Iterator[bytes]:
    """`count` variants of a datagram; changed bytes come from the alphabet half of the time."""
    rng = random.Random(seed)

    def byte() -> int:
        return rng.choice(alphabet) if rng.random() < 0.5 else rng.randrange(256)

    for n in range(count):
        variant = bytearray(data)
        kind = n % 4
        if kind == 0:
            for _ in range(rng.randint(1, 4)):
                variant[rng.randrange(len(variant))] = byte()
        elif kind == 1:
            del variant[rng.randrange(len(variant)) :]
        elif kind == 2:
            at = rng.randrange(len(variant))
            variant[at:at] = bytes(byte() for _ in range(rng.randint(1, 9)))
        else:
            at = rng.randrange(len(variant))
            del variant[at : at + rng.randint(1, 9)]
        yield bytes(variant)
