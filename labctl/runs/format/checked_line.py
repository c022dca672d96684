"""Lines of JSON that carry their own checksum, in files that are only ever appended to.

`{"shard": 3, "crc": "0a1b2c3d"}`: `crc` is always the last key, the CRC-32 (as in zip), 8 hex digits, of the line
without it, that is of `{"shard": 3}`.
"""

import json
import re
import zlib
from collections.abc import Mapping
from typing import Any

_LINE = re.compile(rb'(\{.*), "crc": "([0-9a-f]{8})"\}')


class TornLine(ValueError):
    """A line that ends too early: what a crash in the middle of an append leaves behind."""


def encode(values: Mapping[str, Any]) -> bytes:
    """The line of `values`, one at least, with its checksum and newline."""
    body = json.dumps(dict(values)).encode()
    return body[:-1] + f', "crc": "{zlib.crc32(body):08x}"}}\n'.encode()


def decode(line: bytes) -> dict[str, Any]:
    """The inverse of `encode`.

    Raises:
        TornLine: not a whole line.
        ValueError: its checksum is wrong, or what it was made of is no JSON.
    """
    found = _LINE.fullmatch(line.rstrip(b"\r\n"))
    if not found:
        raise TornLine("not a whole line")
    body = found[1] + b"}"
    if zlib.crc32(body) != int(found[2], 16):
        raise ValueError("checksum is wrong")
    try:
        values: dict[str, Any] = json.loads(body)
    except RecursionError as error:
        raise ValueError(f"lacks {error}") from error
    return values
