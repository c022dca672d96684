"""Random numbers as a function of what they are for: digests as keys of counter-based generators.

Salmon et al., Parallel random numbers: as easy as 1, 2, 3 (Philox), SC11.
"""

import hashlib
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Purpose = str | int | float | bytes

_NAME = b"b" + (16).to_bytes(8, "little")  # what stands before 16 bytes


def encoded(*purpose: Purpose) -> bytes:
    """`purpose` as bytes; parts are told apart by type and length."""
    parts: list[bytes] = []
    for part in purpose:
        if isinstance(part, bytes):
            tag, body = b"b", part
        elif isinstance(part, str):
            tag, body = b"s", part.encode()
        elif isinstance(part, float):
            tag, body = b"f", struct.pack("<d", part)
        else:
            tag, body = b"i", str(int(part)).encode()
        parts += tag, len(body).to_bytes(8, "little"), body
    return b"".join(parts)


def digest(*purpose: Purpose) -> bytes:
    """16 bytes that name `purpose`."""
    return named(encoded(*purpose))


def encoded_name(name: bytes) -> bytes:
    """`encoded` of a name, 16 bytes, in a fifth of the time."""
    return _NAME + name


def derived(names: Sequence[bytes], *purpose: Purpose) -> list[bytes]:
    """`digest` of each of `names` and `purpose`."""
    behind = encoded(*purpose)
    return [named(_NAME + name + behind) for name in names]


def named(purpose: bytes) -> bytes:
    """16 bytes that name what `encoded` gave; encodings one behind the other are that of all their parts."""
    return hashlib.blake2b(purpose, digest_size=16).digest()


def generator(key: bytes) -> np.random.Generator:
    """Philox generator keyed by 16 bytes."""
    return np.random.Generator(np.random.Philox(key=np.frombuffer(key, "<u8")))


class Rekeyed:
    """One Philox generator, for one thread, that starts anew with every key: a tenth of a new one's time."""

    def __init__(self) -> None:
        self._philox = np.random.Philox(key=0)
        self._start = self._philox.state
        self._generator = np.random.Generator(self._philox)

    def generator(self, key: bytes) -> np.random.Generator:
        """As `generator(key)`, until the next call."""
        self._start["state"]["key"] = np.frombuffer(key, "<u8")
        self._philox.state = self._start
        return self._generator

    def unit_noise(self, keys: Sequence[bytes], shape: tuple[int, ...]) -> NDArray[np.float32]:
        """White noise of unit variance: an array of `shape` for each of `keys`, the same however many there are."""
        noise = np.empty((len(keys), *shape), np.float32)
        for key, row in zip(keys, noise, strict=True):
            self.generator(key).standard_normal(out=row, dtype=np.float32)
        return noise
