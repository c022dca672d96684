"""What is usual among differences, as numpy has it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.engine.record_differences import mean, median_and_scatter, part_of, quantile, times_noise

numbers = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20)


@given(numbers, st.floats(0, 1))
def test_quantiles_and_means_are_those_of_numpy(values: list[float], part: float) -> None:
    assert quantile(values, part) == pytest.approx(np.quantile(values, part), abs=1e-6)
    assert mean(np.array(values)) == pytest.approx(np.mean(values), abs=1e-6)


def test_a_stray_value_does_not_change_what_scatters() -> None:
    values = np.random.default_rng(3).normal(5, 2, 4000)
    values[0] = 1e9
    median, scatter = median_and_scatter(values.tolist())
    assert median == pytest.approx(5, abs=0.2)
    assert scatter == pytest.approx(2, rel=0.1)


def test_each_channel_counts_by_its_own_noise() -> None:
    assert times_noise(np.array([4.0, 400.0]), np.array([1.0, 10.0])) == pytest.approx(2)


def test_a_record_holds_all_of_itself_and_nothing_of_another() -> None:
    lit = np.array([[[1.0, -1.0, 1.0, -1.0]]], np.float32)
    other = np.array([[[1.0, 1.0, -1.0, -1.0]]], np.float32)
    assert part_of(lit, lit + 3) == pytest.approx(1)
    assert part_of(lit, other) == pytest.approx(0)
