"""Where the time of a shot goes."""

import pytest

from labctl.engine.profile import Profile


class World:
    """A wall clock that goes on by itself, and a simulated world that computes for a part of that time."""

    def __init__(self) -> None:
        self.now = self.physics = 0.0

    def passes(self, seconds: float, *, computing: float = 0.0) -> None:
        self.now += seconds
        self.physics += computing


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    world = World()
    monkeypatch.setattr("labctl.engine.profile.perf_counter", lambda: world.now)
    return world


def test_what_the_world_computes_during_a_step_is_physics(world: World) -> None:
    profile = Profile(lambda: world.physics)
    with profile.step("transfer"):
        world.passes(5.0, computing=3.0)
    assert profile.budget(10) == {"physics": 300.0, "transfer": 200.0}


def test_what_the_world_computes_beside_a_step_is_no_part_of_it(world: World) -> None:
    profile = Profile(lambda: world.physics)
    with profile.step("transfer"), profile.step("storage_beside_the_next_burst"):
        world.passes(5.0, computing=3.0)
    assert profile.budget(1) == {"physics": 3e3, "transfer": 2e3, "storage_beside_the_next_burst": 5e3}


def test_steps_come_in_the_order_of_a_shot(world: World) -> None:
    profile = Profile(lambda: world.physics)
    for name in ("storage", "upload", "arm"):
        with profile.step(name):
            world.passes(1.0)
    assert list(profile.budget(1)) == ["upload", "arm", "physics", "storage"]
