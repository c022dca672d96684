"""What a bench's answers are read from: which edge, how late, when at rest."""

import numpy as np
import pytest

from instruments.errors import InstrumentError
from protocols.open_questions import EARLIER_S, STEP_S, SWITCH_AFTER_S, WINDOW_S, Switched, switching_answers

LOOKS = np.arange(0, WINDOW_S, STEP_S)


def switched(moves_s: float, lasts_s: float, commanded_s: float) -> Switched:
    """Light that rises evenly for `lasts_s` from `moves_s` on, as the mirrors turn."""
    return Switched(0.01 + 0.2 * np.clip((LOOKS - moves_s) / lasts_s, 0, 1), commanded_s)


@pytest.mark.parametrize("late_s", [0.0, 0.7e-6, 3.1e-6])
def test_latency_and_rest_are_read_to_a_step(late_s: float) -> None:
    two = (switched(commanded + late_s, 1e-6, commanded) for commanded in (SWITCH_AFTER_S, SWITCH_AFTER_S - EARLIER_S))
    edge, late, rest = switching_answers(50e-6, *two)
    assert edge.agrees
    assert float(late.found.split()[0]) == pytest.approx(1e6 * (late_s + 0.5e-6), abs=1e6 * STEP_S)
    assert float(rest.found.split()[0]) == pytest.approx(1e6 * (late_s + 1e-6), abs=1e6 * STEP_S)


def test_a_drive_that_starts_at_the_beginning_of_the_pulse_is_told() -> None:
    two = (switched(6e-6, 1e-6, commanded) for commanded in (SWITCH_AFTER_S, SWITCH_AFTER_S - EARLIER_S))
    edge, _, _ = switching_answers(50e-6, *two)
    assert (edge.found, edge.agrees) == ("its beginning", False)


def test_light_that_does_not_change_is_one_line() -> None:
    noise = np.random.default_rng(1).normal(0, 1e-4, (2, LOOKS.size))
    for still in (np.zeros_like(noise), noise):
        two = (Switched(volts, SWITCH_AFTER_S) for volts in still)
        with pytest.raises(InstrumentError, match="the light does not change when the mirrors turn"):
            list(switching_answers(50e-6, *two))


def test_mirrors_that_take_longer_than_assumed_are_told() -> None:
    two = (switched(commanded, 8e-6, commanded) for commanded in (SWITCH_AFTER_S, SWITCH_AFTER_S - EARLIER_S))
    _, late, rest = switching_answers(5e-6, *two)
    assert late.agrees
    assert not rest.agrees
