"""Levels and likeness since the start: bounded in memory, whole in time."""

import numpy as np
import pytest

from labctl.analysis.course import MOST, begun


def test_a_course_reaches_from_the_start_to_now_however_long_it_is() -> None:
    first = np.array([[0.0, 1.0, 0.0, 1.0], [1.0, 2.0, 3.0, 4.0]])
    course = begun(first)
    for tick in range(3000):
        course = course.with_more(0.1 * tick, first + 1e-3 * tick)
    assert len(course.elapsed_s) == len(course.level_v) == len(course.likeness) < MOST
    assert course.elapsed_s[0] == 0
    assert course.elapsed_s[-1] == 0.1 * 2999
    assert np.allclose(np.diff(course.elapsed_s[:-1]), 0.1 * course.every)
    assert np.allclose(course.level_v[:, 0], 0.5 + 1e-2 * course.elapsed_s)
    assert np.allclose(course.likeness, 1)
    assert course.peak_v == pytest.approx([0.5 + 2.999, 2.5 + 2.999])


@pytest.mark.parametrize("looks", [MOST - 1, MOST, MOST + 1, MOST + 2, 2 * MOST + 7])
def test_the_last_record_is_the_last_one_there_was_however_few_are_kept(looks: int) -> None:
    first = np.array([[0.0, 1.0, 0.0, 1.0]])
    course = begun(first)
    for tick in range(looks):
        course = course.with_more(float(tick), first + tick)
    course = course.with_more(float(looks), 1 - first)
    assert (course.elapsed_s[-1], course.likeness[-1, 0]) == (looks, pytest.approx(-1))
    assert np.all(course.elapsed_s[:-1] % course.every == 0)


def test_another_shape_is_less_alike_and_a_constant_one_is_like_nothing() -> None:
    first = np.array([[0.0, 1.0, 0.0, 1.0]])
    course = begun(first).with_more(0.0, first).with_more(1.0, 1 - first).with_more(2.0, np.ones((1, 4)))
    assert course.likeness[:2, 0] == pytest.approx([1, -1])
    assert np.isnan(course.likeness[2, 0])
