"""Independent tasks: what each of them leaves behind."""

import weakref

from labctl.studies.tasks import timed


class Bench:
    """It knows itself, as the parts of a bench know each other."""

    def __init__(self) -> None:
        self.other = self


def left_behind() -> "weakref.ref[Bench]":
    """A bench that nobody has any more, and that still knows itself."""
    return weakref.ref(Bench())


def test_what_knows_itself_is_gone_when_its_task_is_done() -> None:
    left, _ = timed(left_behind)
    assert left() is None
