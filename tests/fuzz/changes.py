"""Bytes as somebody might change them: some replaced, taken out, put in, doubled, or the end cut off."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from hypothesis import strategies as st

TOKENS = (
    *(b"", b"\n", b"\r", b"\0", b'"', b"'", b"[", b"]", b"{", b"}", b"=", b",", b";", b"<", b">", b"<a>", b"\\u0000"),
    *(
        b"-1",
        b"0",
        b"1e999",
        b"NaN",
        b"nan",
        b"inf",
        b"Infinity",
        b"null",
        b"true",
        b"9" * 20,
        b"9" * 5000,
        b"\xc2\xb2",
    ),
    *(b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x00" * 8, b"../", b"/etc/", b"\x1b[2J"),
)
"""What is put in beside random bytes: what parsers trip over."""


@dataclass(frozen=True)
class Change:
    """One change, wherever `place` falls in the bytes it is made to: what replaces `length` bytes, or how."""

    kind: str
    place: int
    length: int
    put: bytes
    times: int


CHANGES = st.lists(
    st.builds(
        Change,
        kind=st.sampled_from(("replace", "replace", "double", "delete", "number", "flip")),
        place=st.integers(0, 1 << 20),
        length=st.sampled_from((0, 1, 2, 4, 8, 40)),
        put=st.one_of(st.binary(max_size=8), st.sampled_from(TOKENS)),
        times=st.integers(1, 50),
    ),
    max_size=8,
)
END = st.one_of(st.none(), st.none(), st.integers(0, 1 << 20))
"""Where the end is cut off; None: nowhere."""


def changed(valid: bytes, changes: Sequence[Change], end: int | None) -> bytes:
    """Valid bytes with these changes."""
    content = bytearray(valid)
    for change in changes:
        first = change.place % (len(content) + 1)
        last = min(len(content), first + change.length)
        numbers = list(re.finditer(rb"[0-9]+", content)) if change.kind == "number" else []
        if change.kind == "replace":
            content[first:last] = change.put
        elif change.kind == "double":
            content[first:first] = content[first:last] * change.times
        elif change.kind == "delete":
            del content[first:last]
        elif numbers:
            first, last = numbers[change.place % len(numbers)].span()
            content[first:last] = change.put
        elif content:
            content[first % len(content)] ^= 1 << change.times % 8
    return bytes(content if end is None else content[: end % (len(content) + 1)])
