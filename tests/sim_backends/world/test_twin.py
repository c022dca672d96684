"""What twins leave in memory, of those that a process has drawn."""

import gc
import weakref
from collections.abc import Iterator

import pytest

from sim_backends.parameters import Parameters
from sim_backends.world.signals import Emission
from sim_backends.world.twin import Setting, drawn_twin

LIT = Setting(Emission(1550.0, 0.03), None, (1, 2), 0)
MANY = 4


@pytest.fixture
def circles_stay() -> Iterator[None]:
    """Nobody looks for objects that refer to themselves, as for those that were there before a run."""
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("circles_stay")
def test_only_the_latest_ones_are_kept() -> None:
    twins = []
    for seed in range(MANY):
        twin = drawn_twin(Parameters(), seed)
        twin.optics(LIT)
        twins.append(weakref.ref(twin))
    del twin
    assert [twin() is not None for twin in twins] == [False, False, True, True]
