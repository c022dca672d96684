"""Forms are made from schemas, of whatever protocol."""

import pytest

from labctl.bench.schema import schema_of
from labctl.dashboard.settings_fields import about, refused, settings_of, text_of
from protocols.registry import protocol_from, protocol_names


@pytest.mark.parametrize("name", protocol_names())
def test_what_stands_in_the_fields_of_a_protocol_is_what_it_usually_does(name: str) -> None:
    settings = settings_of(schema_of(name))
    typed = {one.name: one.usual for one in settings if one.usual}
    assert protocol_from(name, typed, origin="form") == protocol_from(name, {}, origin="form")
    assert about(schema_of(name))


def test_fields_have_units_choices_and_bounds() -> None:
    found = {one.name: one for one in settings_of(schema_of("image-readout"))}
    assert (found["window"].usual, found["window"].hint) == ("2 ns", "in s")
    assert found["timing"].choices == ("software", "burst")
    assert found["averages"].hint == "from 1 to 10240"
    assert found["images"].hint == "above 0 or all"
    assert found["wavelengths"].usual == "1550 nm"
    assert found["image_seed"].usual == ""


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(25e9, "Hz", "25 GHz"), (0.0, "s", "0 s"), (0.03, "W", "30 mW"), (True, "", "true"), ((2, 3), "", "2,3")],
)
def test_values_are_written_as_they_are_typed(value: object, unit: str, text: str) -> None:
    assert text_of(value, unit) == text


def test_what_is_refused_is_told_at_its_field() -> None:
    assert refused("--set: images = '-3': '-3' is not a number") == ("images", "'-3' is not a number")
    assert refused("no data set is called 'nothing'") == ("", "no data set is called 'nothing'")
