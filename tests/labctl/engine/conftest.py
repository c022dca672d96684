"""A clock for what counts seconds of its own."""

import pytest


class Clock:
    """A clock that is set by hand, s."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()
