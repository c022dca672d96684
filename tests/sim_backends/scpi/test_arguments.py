"""Kinds of arguments: what they read, what they refuse, and that they read what they write."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.scpi.arguments import (
    Kind,
    block,
    boolean,
    channels,
    integer,
    keyword,
    nr3,
    number_or_word,
    optional,
    quoted,
    quoted_or_all,
    quoted_or_bare,
    real,
    run_or_stop,
    several,
    short_form,
)
from sim_backends.scpi.status import ScpiError

MODE = keyword("CONTinuous", "TRIGgered")


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (real(), "2.5E10", 2.5e10),
        (real(), "-.5e-3", -0.5e-3),
        (real(), "+7.", 7.0),
        (real(), "2.5 E 10", 2.5e10),
        (real(-5, 5, TTL=1.4), "ttl", 1.4),
        (real(0, 10, MAXimum=10), "max", 10.0),
        (integer(), "5000", 5000),
        (integer(0, 10**12), "1E12", 10**12),
        (integer(), "2.6", 3),
        (integer(), "#H1f", 31),
        (integer(), "#Q17", 15),
        (number_or_word(1, 9, "NEXT", "FIRSt"), "3", 3),
        (number_or_word(1, 9, "NEXT", "FIRSt"), "first", "FIRSt"),
        (quoted_or_bare, "plain", "plain"),
        (quoted_or_bare, '"a b"', "a b"),
        (integer(), "#b01", 1),
        (boolean, "ON", True),
        (boolean, "off", False),
        (boolean, "0.4", False),
        (boolean, "2", True),
        (boolean, "1e999", True),
        (run_or_stop, "Run", True),
        (run_or_stop, "STOP", False),
        (MODE, "cont", "CONTinuous"),
        (MODE, "CONTINUOUS", "CONTinuous"),
        (quoted, '"a ""b"""', 'a "b"'),
        (quoted, "'a ''b'''", "a 'b'"),
        (quoted, '""', ""),
        (quoted_or_all, "all", "ALL"),
        (quoted_or_all, '"all"', "all"),
        (channels(2), "(@1!2, 3!14)", ((1, 2), (3, 14))),
        (channels(1), "(@4)", ((4,),)),
    ],
)
def test_reads(kind: Kind, text: str, value: Any) -> None:
    assert kind.parse(text) == value


@pytest.mark.parametrize(
    ("kind", "text", "code"),
    [
        (real(0, 1), "1.5", -222),
        (real(), "1e999", -222),
        (real(), "nan", -104),
        (real(), "inf", -104),
        (real(), "1_000", -104),
        (real(), "25GS/s", -104),
        (real(), "", -104),
        (real(), memoryview(b"1"), -104),
        (integer(0, 10), "11", -222),
        (integer(0, 10), "1e300", -222),
        (integer(), "#B12", -104),
        (integer(), "x", -104),
        (boolean, "maybe", -104),
        (MODE, "CONTIN", -224),
        (MODE, "", -224),
        (quoted, "bare", -104),
        (quoted, '"open', -104),
        (quoted, '"', -104),
        (channels(2), "(@1)", -104),
        (channels(2), "(@1!2,)", -104),
        (channels(1), "@1", -104),
        (block("<f4"), "12", -160),
        (block("<f4"), memoryview(b"12345"), -161),
    ],
)
def test_refuses(kind: Kind, text: str | memoryview, code: int) -> None:
    with pytest.raises(ScpiError) as caught:
        kind.parse(text)
    assert caught.value.code == code


def test_blocks_are_views_of_the_received_bytes() -> None:
    sent = np.array([0.5, -1.0], "<f4")
    received = block("<f4").parse(sent.data.cast("B"))
    assert np.array_equal(received, sent)
    assert np.shares_memory(received, sent)


@given(st.floats(-1e300, 1e300, allow_subnormal=False))
def test_reals_come_back_as_written(value: float) -> None:
    assert math.isclose(real().parse(nr3(value)), value, rel_tol=1e-10, abs_tol=0.0)


@given(st.integers(-(10**15), 10**15))
def test_integers_come_back_as_written(value: int) -> None:
    kind = integer(-(10**15), 10**15)
    assert kind.parse(kind.format(value, verbose=False)) == value


@given(st.text(st.characters(codec="latin-1")))
def test_strings_come_back_as_written(value: str) -> None:
    assert quoted.parse(quoted.format(value, verbose=False)) == value


@given(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 99)), min_size=1))
def test_channel_lists_come_back_as_written(value: list[tuple[int, int]]) -> None:
    assert channels(2).parse(channels(2).format(tuple(value), verbose=False)) == tuple(value)


@given(st.text(max_size=20), st.sampled_from([real(), integer(), boolean, MODE, quoted, channels(2), block("<f4")]))
def test_any_text_is_read_or_refused(text: str, kind: Kind) -> None:
    codes = []
    try:
        kind.parse(text)
    except ScpiError as error:
        codes.append(error.code)
    assert not set(codes) - {-104, -160, -222, -224}


def test_replies_use_long_words_when_verbose() -> None:
    assert MODE.format("TRIGgered", verbose=True) == "TRIGGERED"
    assert MODE.format("TRIGgered", verbose=False) == "TRIG"
    assert short_form("BYT_Nr") == "BYT_N"
    assert several(MODE).format(("CONTinuous", "TRIGgered"), verbose=False) == "CONT,TRIG"
    assert several(MODE).parse("TRIG") == ("TRIGgered",)
    assert not optional(MODE).required
