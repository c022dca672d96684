"""A bounded number of the answers that `make fuzz` draws for hours."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.answers import LIVES, answers_are_taken_or_refused


@pytest.mark.parametrize("role", LIVES)
@settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_a_changed_answer_is_taken_or_refused(data: st.DataObject, role: str) -> None:
    answers_are_taken_or_refused(data, role)
