"""The safe state: laser off, AWG off, DMD blank, oscilloscope stopped; every step taken however another one ends."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager

from instruments.errors import InstrumentError, LinkError


class UnsafeBench(InstrumentError):
    """The safe state could not be confirmed; the message names every instrument that did not obey.

    Attributes:
        disobeyed: those instruments, by their names in the bench; none where there was no light.
    """

    def __init__(self, message: str, disobeyed: Iterable[str] = ()) -> None:
        """Of the instruments `disobeyed`."""
        super().__init__(message)
        self.disobeyed = frozenset(disobeyed)


@contextmanager
def ending_with(end: Callable[[], None]) -> Iterator[None]:
    """Call `end` after the block, however it ends.

    An error of the block stays the one that is raised, since it came first: what `end` then fails at is a note to it.
    """
    try:
        yield
    except GeneratorExit:  # no failure of the block, and nobody would read a note to it
        end()
        raise
    except BaseException as error:
        try:
            end()
        except (InstrumentError, OSError) as failure:
            for line in (str(failure), *getattr(failure, "__notes__", ())):
                error.add_note(line)
        raise
    else:
        end()


def safe_state(steps: dict[str, Callable[[], None]]) -> None:
    """Take the steps of instruments, by name, into the safe state: in their order, each one however another ends.

    Raises:
        UnsafeBench: an instrument did not obey.
    """
    failures: dict[str, InstrumentError | OSError] = {}

    def take(name: str, step: Callable[[], None]) -> None:
        try:
            _over_a_new_link(step)
        except (InstrumentError, OSError) as error:
            failures[name] = error

    with ExitStack() as stack:  # which calls them all, whatever one of them raises
        for name, step in reversed(steps.items()):
            stack.callback(take, name, step)
    if failures:
        failed = "; ".join(f"{name}: {error}" for name, error in failures.items())
        dark = "laser" in steps and "laser" not in failures
        advice = "the laser is off" if dark else "the laser may still emit, switch it off by its key switch"
        raise UnsafeBench(f"the safe state is not confirmed ({failed}): {advice}", failures)


def _over_a_new_link(step: Callable[[], None]) -> None:
    """Once more if the link that is there was broke unnoticed, as idle links do."""
    try:
        step()
    except LinkError:
        step()
