import pytest

from sim_backends.world.clock import VirtualClock


def test_clock_goes_forward_only() -> None:
    clock = VirtualClock()
    clock.advance(1.5)
    assert clock.now == 1.5
    with pytest.raises(ValueError, match="at least 0"):
        clock.advance(-1.0)
    with pytest.raises(ValueError, match="at least 0"):
        clock.advance(float("nan"))
