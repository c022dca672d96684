"""Who listens to what goes over the links: message by message, or byte by byte."""

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

Transcript = Callable[[str, str, str], None]
"""Called with instrument name, direction ("<" from, ">" to the instrument) and the text of each message."""


class SessionTap(Protocol):
    """Hears every byte of one open session, terminators and block headers included."""

    def heard(self, direction: str, chunks: Sequence[bytes | bytearray | memoryview]) -> None:
        """One message, in pieces, so that blocks need not be copied; directions as in `Transcript`."""

    def closed(self) -> None:
        """The session is over."""


@runtime_checkable
class ByteTranscript(Protocol):
    """A `Transcript` that also wants every byte, as a recording does."""

    def __call__(self, instrument: str, direction: str, message: str, /) -> None:
        """Log the text of one message."""

    def tap(self, instrument: str, resource: str) -> SessionTap:
        """A session to `instrument` at `resource` was opened: who hears its bytes."""
