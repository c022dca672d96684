import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.world import triggers


def test_marker_edges_wrap_round() -> None:
    marker = np.array([True, True, False, False, True])
    assert triggers.marker_edges(marker, rising=True).tolist() == [4]
    assert triggers.marker_edges(marker, rising=False).tolist() == [2]
    assert triggers.marker_edges(np.ones(4, bool), rising=True).size == 0


def test_level_crossings_are_interpolated() -> None:
    trace = np.array([0.0, 1.0, 1.0, 0.0], np.float32)
    assert triggers.level_crossings(trace, 0.25, rising=True).tolist() == [0.25]
    assert triggers.level_crossings(trace, 0.25, rising=False).tolist() == [2.75]
    assert triggers.level_crossings(trace, 2.0, rising=True).size == 0


@given(
    st.lists(st.integers(0, 99), min_size=1, max_size=4, unique=True),
    st.floats(0, 1e-3),
    st.integers(1, 8),
    st.floats(0, 3e-7),
)
def test_upcoming_events_are_the_next_ones(places: list[int], after: float, count: int, holdoff: float) -> None:
    phases = np.sort(np.array(places)) * 1e-9
    times = triggers.upcoming(phases, 100e-9, after=after, count=count, holdoff=holdoff)
    assert times.size == count
    assert times[0] >= after - 1e-12
    assert times[0] <= after + 100e-9 + 1e-12
    gaps = np.diff(times)
    assert np.all(gaps >= max(holdoff, 1e-9) - 1e-12)
    assert np.all(gaps <= holdoff + 100e-9 + 1e-12)
    away = np.abs((times[:, None] - phases + 50e-9) % 100e-9 - 50e-9).min(axis=1)
    assert away == pytest.approx(0, abs=1e-12)
