"""The safe state: laser off, AWG off, DMD blank, oscilloscope stopped; every step taken however another one ends.

What follows the laser in the light's way comes before it: attenuator shut, amplifier off.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import TypeVar

from instruments.errors import InstrumentError, LinkError

ORDER: Mapping[str, str] = {
    "attenuator": "attenuator shut",
    "amplifier": "amplifier off",
    "laser": "laser off",
    "awg": "AWG output off",
    "dmd": "DMD blank",
    "scope": "oscilloscope stopped",
}
"""The safe state in its order: what is reached with each instrument. Those with other roles follow."""
LIGHT = ("attenuator", "amplifier", "laser")
"""Those of them that give light or let it through."""
MAY_EMIT: Mapping[str, str] = {
    "laser": "the laser may still emit, switch it off by its key switch",
    "amplifier": "the amplifier may still emit, switch it off at its front panel",
}
"""What is said of the instruments that emit, an amplifier by itself among them, when they do not obey."""

Of = TypeVar("Of")


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
    """Call `end` after the block, however it ends; where it ends early, as `failing_with` does."""
    with failing_with(end):
        yield
    end()


@contextmanager
def failing_with(end: Callable[[], None]) -> Iterator[None]:
    """Call `end` if the block ends early.

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


def in_order(by_role: Mapping[str, Of]) -> dict[str, Of]:
    """What there is of each instrument, in the order of the safe state; those that it does not name keep theirs."""
    named = {role: by_role[role] for role in ORDER if role in by_role}
    return {**named, **by_role}


def safe_state(steps: dict[str, Callable[[], None]], *, emits: bool = True) -> None:
    """Take the steps of instruments, by name, into the safe state: in their order, each one however another ends.

    emits: whether they are instruments that can give light, and not a recording of some.

    Raises:
        UnsafeBench: an instrument did not obey, or its driver failed; caused by the first of these errors.
    """
    failures: dict[str, Exception] = {}

    def take(name: str, step: Callable[[], None]) -> None:
        try:
            over_a_new_link(step)
        except Exception as error:  # noqa: BLE001 -- a defect of a driver leaves its instrument as it is
            failures[name] = error

    with ExitStack() as stack:  # which calls them all, whatever one of them raises
        for name, step in reversed(steps.items()):
            stack.callback(take, name, step)
    if failures and not emits:
        raise UnsafeBench(f"the recording has no safe state: {'; '.join(map(_told, failures.values()))}")
    if failures:
        failed = "; ".join(f"{name}: {_told(error)}" for name, error in failures.items())
        dark = "laser" in steps and "laser" not in failures
        advice = "the laser is off" if dark else MAY_EMIT["laser"]
        if "amplifier" in failures:
            advice += f"; {MAY_EMIT['amplifier']}"
        first = next(iter(failures.values()))
        raise UnsafeBench(f"the safe state is not confirmed ({failed}): {advice}", failures) from first


def _told(error: Exception) -> str:
    """An error in one line; one that nobody wrote for people, with its kind."""
    if isinstance(error, InstrumentError | OSError):
        return str(error)
    return " ".join(f"{type(error).__name__}: {error}".split())


def over_a_new_link(step: Callable[[], object]) -> None:
    """Once more if the link that is there was broke unnoticed, as idle links do."""
    try:
        step()
    except LinkError as error:
        if error.silent:  # over a link as new as another one would be
            raise
        step()
