"""A virtual generator on a world that notes what it is told."""

import pytest

from sim_backends.virtual import VirtualAwg70002a
from tests.sim_backends.virtual.awg70002a.session import Heard


@pytest.fixture(scope="module")
def quiet() -> Heard:
    return Heard()


@pytest.fixture
def heard(quiet: Heard) -> Heard:
    quiet.play(None)
    quiet.played.clear()
    quiet.triggers = 0
    return quiet


@pytest.fixture
def awg(heard: Heard) -> VirtualAwg70002a:
    return VirtualAwg70002a(heard)
