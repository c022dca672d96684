"""Quantities as people write them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from instruments.units import quantity


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.4 ns", "s", 4e-10),
        ("25 GS/s", "Hz", 25e9),
        ("25GSa/s", "Hz", 25e9),
        ("12.5 GHz", "Hz", 12.5e9),
        ("1550 nm", "nm", 1550.0),
        ("1.55 um", "nm", 1550.0),
        ("13 dBm", "W", 1.99526231497e-2),
        ("30 mW", "W", 0.03),
        ("0.5 Vpp", "V", 0.5),
        ("500 mVpp", "V", 0.5),
        ("-1e3 mV", "V", -1.0),
        ("2 µs", "s", 2e-6),
        ("2 \N{GREEK SMALL LETTER MU}s", "s", 2e-6),
        ("1.5 hours", "s", 5400.0),
        ("3 milliseconds", "s", 3e-3),
        ("1550 nanometers", "nm", 1550.0),
        ("1 milliwatt", "W", 1e-3),
    ],
)
def test_reads_what_people_write(text: str, unit: str, value: float) -> None:
    assert quantity(text, unit) == pytest.approx(value, rel=1e-7)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("0.4", "s"),
        ("ns", "s"),
        ("", "s"),
        ("5 V", "s"),
        ("5 parsnips", "W"),
        ("1 s s", "s"),
        ("1;import os", "s"),
        ("1 ns/", "s"),
        ("5000 dBm", "W"),
        ("1e999 W", "W"),
    ],
)
def test_refuses_the_rest_in_one_line(text: str, unit: str) -> None:
    with pytest.raises(ValueError, match="write it like") as refused:
        quantity(text, unit)
    assert "\n" not in str(refused.value)


@given(st.floats(min_value=1e-6, max_value=1e6))
def test_nanoseconds_round_trip(value: float) -> None:
    assert quantity(f"{value!r} ns", "s") == pytest.approx(value * 1e-9, rel=1e-11)


@given(st.text(max_size=20))
def test_no_text_breaks_it(text: str) -> None:
    try:
        quantity(text, "s")
    except ValueError:
        return
