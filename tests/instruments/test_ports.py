"""Lists of ports as they are typed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from instruments.ports import parse_ports


@given(st.lists(st.integers(0, 14), min_size=1, unique=True))
def test_port_lists_round_trip(ports: list[int]) -> None:
    assert parse_ports(",".join(map(str, ports))) == tuple(ports)


def test_ranges_and_single_ports() -> None:
    assert parse_ports("0,2-4, 6") == (0, 2, 3, 4, 6)
    assert parse_ports(3) == (3,)
    with pytest.raises(ValueError, match=r"'2-x' is not a list of ports: write it like '2-6'"):
        parse_ports("2-x")


@given(st.integers(0, 14), st.integers(0, 14), st.sampled_from(["", " "]))
def test_a_range_rises_from_its_first_port_to_its_last(first: int, last: int, space: str) -> None:
    text = f"{first}{space}-{space}{last}"
    if first <= last:
        assert parse_ports(text) == tuple(range(first, last + 1))
    else:
        with pytest.raises(ValueError, match="is not a list of ports: write it like '2-6' or '2,3,5'"):
            parse_ports(text)


@given(st.integers(0, 14), st.sampled_from(["{}-", "-{}", "{}- ", "{}-,5", "3,{}-", "2-{}-", "{},"]))
def test_a_range_without_an_end_is_none(port: int, cut: str) -> None:
    with pytest.raises(ValueError, match="is not a list of ports: write it like '2-6' or '2,3,5'"):
        parse_ports(cut.format(port))


def test_a_port_that_the_chip_does_not_have() -> None:
    with pytest.raises(ValueError, match=r"the chip has ports 1 to 14, and 0 is the fibre before it"):
        parse_ports("2-99")
