"""The person at the bench: asked at the terminal for what software cannot do there."""

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

from instruments.errors import InstrumentError
from labctl.printable import printable

_cleared: list[Callable[[], AbstractContextManager[object]]] = [nullcontext]


@contextmanager
def asked_on(cleared: Callable[[], AbstractContextManager[object]]) -> Iterator[None]:
    """Until the block ends, ask inside `cleared()`: whoever draws on the terminal leaves it alone there."""
    _cleared.append(cleared)
    try:
        yield
    finally:
        _cleared.remove(cleared)


def ask_operator(request: str) -> str:
    """Ask at the terminal and wait for an answer.

    Raises:
        InstrumentError: nobody is there to answer.
    """
    with _cleared[-1]():
        print(printable(request), end=": ", file=sys.stderr, flush=True)  # noqa: T201
        try:
            return input()
        except EOFError:
            raise InstrumentError(f"nobody answered {request!r}: run this from a terminal") from None
