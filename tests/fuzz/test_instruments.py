"""A bounded number of the inputs that `make fuzz` draws for hours."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.inputs import MODELS
from tests.fuzz.properties import PROPERTIES, Property


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("holds", PROPERTIES.values(), ids=PROPERTIES)
@settings(max_examples=8, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_property(data: st.DataObject, holds: Property, name: str) -> None:
    holds(data, MODELS[name])
