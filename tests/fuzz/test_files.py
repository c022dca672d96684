"""A bounded number of the changed files that `make fuzz` draws for hours."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.files import SUBJECTS, taken_or_refused


@pytest.mark.parametrize("kind", SUBJECTS)
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_a_changed_file_is_taken_or_refused(data: st.DataObject, kind: str) -> None:
    taken_or_refused(data, kind)
