"""Replies that do not come as they should, in words that every transport can obey."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Disturbed:
    """A reply as a fault leaves it.

    Raw sockets have neither ends, numbers, announcements nor errors of their own: they send `data`.

    Attributes:
        data: What comes in its place, its line feed included; nothing at all if it is empty.
        late: It comes ahead of the next reply on the same link, if there is one.
        ends_after: After so many bytes of it the link ends; None: it does not.
        packet: Bytes that come at once; None: all of them.
        ends: Whether the transport marks its end (HiSLIP: DataEnd; VXI-11: the reason END).
        numbered: Added to the number by which the transport says what it answers (HiSLIP: message id; VXI-11: xid).
        announced: Bytes that the transport announces beyond those that come.
        fragments: Pieces into which the transport cuts it, each in a frame of its own.
        error: The transport's own error in its place (HiSLIP: FatalError, which ends the link; VXI-11: device_read).
    """

    data: bytes = b""
    late: bool = False
    ends_after: int | None = None
    packet: int | None = None
    ends: bool = True
    numbered: int = 0
    announced: int = 0
    fragments: int = 1
    error: int | None = None

    @property
    def hangs_up(self) -> bool:
        """Whether the link ends."""
        return self.ends_after is not None


INTACT = Disturbed()
"""An answer that nothing happens to on its way."""


def pieces(data: bytes, longest: int | None) -> list[bytes]:
    """`data` in pieces of at most `longest` bytes; None: in one."""
    step = longest or max(1, len(data))
    return [data[at : at + step] for at in range(0, len(data), step)]


def fragments(data: bytes, count: int) -> list[bytes]:
    """`data` in `count` pieces of about the same length, or as many as it has bytes; one if it is empty."""
    return pieces(data, -(-len(data) // count)) or [b""]
