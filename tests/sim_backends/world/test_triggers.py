import numpy as np

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
