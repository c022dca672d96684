"""A virtual oscilloscope that is set up, on a world with light."""

import pytest

from sim_backends.virtual import VirtualDpo72504dx
from tests.sim_backends.virtual.dpo72504dx.session import WHOLE_SESSION, lit, set_up
from tests.sim_backends.virtual.watched import Ask, Watched


@pytest.fixture
def world() -> Watched:
    return lit()


@pytest.fixture
def session() -> tuple[str, ...]:
    """What the oscilloscope is set up with; a file may have its own."""
    return WHOLE_SESSION


@pytest.fixture
def scope(ask: Ask, world: Watched, session: tuple[str, ...]) -> VirtualDpo72504dx:
    return set_up(ask, world, session)
