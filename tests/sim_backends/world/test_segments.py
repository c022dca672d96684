"""Which edges start segments, against a plain walk through the edges."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.world.segments import DEFAULT_LEVEL_V, SegmentStarts
from sim_backends.world.signals import Playback, Projection

RATE = 1e9
PICTURE = np.zeros((1, 784), np.uint16)


def playback(lengths: tuple[int, ...], *, runs_on: bool = False) -> Playback:
    count = sum(lengths)
    return Playback(np.zeros(count, np.float32), np.ones(count, bool), 0.0, 1.0, RATE, lengths, runs_on)


def starts_of(played: Playback, projection: Projection) -> SegmentStarts:
    return SegmentStarts(played, DEFAULT_LEVEL_V, rising=True, projection=projection, now_s=0.0)


def walked(edges: list[float], lengths: tuple[int, ...], *, runs_on: bool) -> list[tuple[float, int]]:
    """Every edge in order: heeded unless something plays."""
    starts: list[tuple[float, int]] = []
    for edge in edges:
        if starts:
            last, number = starts[-1]
            if runs_on and number == len(lengths) - 1:
                break
            if edge < last + lengths[number] / RATE - 1e-11:
                continue
        starts.append((edge, len(starts) % len(lengths)))
    return starts


@given(
    st.lists(st.integers(10, 250_000), min_size=1, max_size=4).map(tuple),
    st.booleans(),
    st.integers(1, 40),
    st.lists(st.integers(1, 3000), max_size=4, unique=True).map(sorted),
)
def test_frame_synch_and_software_edges(
    lengths: tuple[int, ...], runs_on: bool, pictures: int, software: list[int]
) -> None:
    starts = starts_of(playback(lengths, runs_on=runs_on), Projection(PICTURE, 0.0, 50e-6, 7.3e-6, repeats=pictures))
    edges = [7.3e-6 + 50e-6 * number for number in range(pictures)]
    for time in software:
        starts.edge(time * 1e-6)
        edges.append(time * 1e-6)
    expected = walked(sorted(edges), lengths, runs_on=runs_on)
    times = np.array([start for start, _ in expected])
    found, numbers = starts.latest(times + 1e-10)
    assert found == pytest.approx(times, abs=1e-11)
    assert numbers.tolist() == [number for _, number in expected]
    assert starts.latest(times[:1] - 1e-9)[1].tolist() == [-1]
    seen = starts.marker_edges(len(expected), rising=True, after_s=0.0, holdoff_s=0.0)
    assert seen[: len(expected)] == pytest.approx(times, abs=1e-11)
    assert len(starts.marker_edges(999, rising=True, after_s=0.0, holdoff_s=0.0)) == len(expected)


def test_a_marker_that_never_rises_gives_no_edge() -> None:
    unmarked = Playback(np.zeros(9, np.float32), np.zeros(9, bool), 0.0, 1.0, RATE, (4, 5))
    starts = starts_of(unmarked, Projection(PICTURE, 0.0, 50e-6, loop=True))
    assert starts.marker_edges(3, rising=True, after_s=0.0, holdoff_s=0.0) == []
    assert starts.latest(np.array([1e-3]))[1].tolist() == [1 - (1e-3 / 50e-6 + 1) % 2]


def test_an_inverted_pulse_ends_with_the_rising_edge() -> None:
    starts = starts_of(playback((4,)), Projection(PICTURE, 0.0, 50e-6, synch_pulse_s=5e-6, synch_high=False))
    assert starts.marker_edges(3, rising=True, after_s=0.0, holdoff_s=0.0) == pytest.approx([5e-6])


def test_a_playback_that_repeats_for_ever_has_no_segments() -> None:
    continuous = Playback(np.zeros(9, np.float32), np.zeros(9, bool), 0.0, 1.0, RATE)
    with pytest.raises(ValueError, match="give one with lengths"):
        starts_of(continuous, Projection(PICTURE, 0.0, 50e-6))
