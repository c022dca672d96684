"""Servers that run for as long as a command needs them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

from labctl.errors import UsageError


class Server(Protocol):
    """What can be started and stopped."""

    def start(self) -> object:
        """Listen."""

    def stop(self) -> None:
        """Close every connection."""


Served = TypeVar("Served", bound=Server)


@contextmanager
def serving(server: Served, options: str) -> Iterator[Served]:
    """`server` inside the block; `options` are those that say where it listens.

    Raises:
        UsageError: it cannot listen there.
    """
    try:
        server.start()
    except OSError as error:
        raise UsageError(f"{options}: {error.strerror}") from None
    try:
        yield server
    finally:
        server.stop()
