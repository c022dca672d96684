"""Tables of commands: which header means which command, and how arguments are bound."""

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.scpi import commands
from sim_backends.scpi.arguments import block, integer, keyword, optional, quoted, real, several, short_form
from sim_backends.scpi.commands import Action, Command, CommandTable, Query, Setting, bind, chunks, reply_header
from sim_backends.scpi.status import ScpiError

AMPLITUDE = Setting("SOURce#:VOLTage[:LEVel][:IMMediate][:AMPLitude]", "sources#.amplitude", real())
OFFSET = Setting("SOURce#:VOLTage[:LEVel][:IMMediate]:OFFSet", "sources#.offset", real())
STATE = Setting("OUTPut#[:STATe]", "outputs#.on", real())
ALL_OFF = Setting("OUTPut:OFF", "all_off", real())
RUN = Action("AWGControl:RUN[:IMMediate]", "run")
NEXT = Query("SYSTem:ERRor[:NEXT]?", "next")
READ_ONLY = Setting("WFMOutpre:NR_Pt?", "points", real())
LEADING = Action("[:SOURce]:SWEep", "sweep")
IDENTIFY = Query("*IDN?", "identify")

TABLE = CommandTable(
    (AMPLITUDE, OFFSET, STATE, ALL_OFF, RUN, NEXT, READ_ONLY, LEADING, IDENTIFY), {"SOURce": 2, "OUTPut": 2}
)
SCOPE = CommandTable((Setting("CH#:SCAle", "channels#.scale", real()),), {"CH": 4}, default_suffix=None)


@pytest.mark.parametrize(
    ("header", "query", "command", "suffixes"),
    [
        ("SOURce1:VOLTage", True, AMPLITUDE, (1,)),
        ("sour2:volt:lev:imm:ampl", False, AMPLITUDE, (2,)),
        (":SOURCE:VOLTAGE:AMPL", False, AMPLITUDE, (1,)),
        ("SOUR:VOLT:IMMediate", False, AMPLITUDE, (1,)),
        ("SOUR:VOLT:OFFS", True, OFFSET, (1,)),
        ("OUTP2", True, STATE, (2,)),
        ("outp:stat", False, STATE, (1,)),
        ("OUTPut:OFF", True, ALL_OFF, ()),
        ("AWGC:RUN:IMM", False, RUN, ()),
        ("SYST:ERR", True, NEXT, ()),
        ("wfmoutpre:nr_pt", True, READ_ONLY, ()),
        ("SWE", False, LEADING, ()),
        ("SOUR:SWEEP", False, LEADING, ()),
        ("*idn", True, IDENTIFY, ()),
    ],
)
def test_finds(header: str, query: bool, command: Command, suffixes: tuple[int, ...]) -> None:
    found = TABLE.find("", header, query=query)
    assert (found.command, found.suffixes) == (command, suffixes)
    assert TABLE.find("", header, query=query) is found


@pytest.mark.parametrize(
    ("header", "query", "code"),
    [
        ("FOO", False, -113),
        ("SOUR", False, -113),
        ("SOURC1:VOLT", True, -113),
        ("SOUR:VOLT:AMPL:LEV", True, -113),
        ("OUTPut2:OFF", True, -113),
        ("AWGC:RUN", True, -113),
        ("SYST:ERR", False, -113),
        ("WFMO:NR_P", False, -113),
        ("SOUR3:VOLT", True, -114),
        ("SOUR0:VOLT", True, -114),
        ("SOUR99999999999:VOLT", True, -113),
        ("::VOLT", True, -113),
        ("SOUR1:VOLT?", True, -113),
        ("", False, -113),
    ],
)
def test_refuses(header: str, query: bool, code: int) -> None:
    with pytest.raises(ScpiError) as caught:
        TABLE.find("", header, query=query)
    assert caught.value.code == code


def test_a_suffix_can_be_required() -> None:
    assert SCOPE.find("", "CH3:SCA", query=True).suffixes == (3,)
    with pytest.raises(ScpiError, match="-113"):
        SCOPE.find("", "CH:SCA", query=True)


def test_a_bare_header_continues_the_path_of_the_one_before() -> None:
    first = TABLE.find("", "SOURce2:VOLTage:OFFSet", query=False)
    assert TABLE.find(first.path, "LEV", query=True).suffixes == (2,)
    assert TABLE.find(first.path, "LEV", query=True).command is AMPLITUDE
    common = TABLE.find(first.path, "*IDN", query=True)
    assert TABLE.find(common.path, "OFFS", query=True).command is OFFSET
    assert TABLE.find(first.path, ":OUTP1", query=True).command is STATE
    with pytest.raises(ScpiError, match="-113"):
        TABLE.find(first.path, "OUTP1", query=True)


def test_many_spellings_do_not_fill_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "_CACHED_SPELLINGS", 4)
    table = CommandTable((AMPLITUDE,), {"SOURce": 2})
    for bits in range(2**4):
        spelling = "".join(c.upper() if bits >> i & 1 else c for i, c in enumerate("sour")) + ":volt"
        assert table.find("", spelling, query=True).command is AMPLITUDE
    assert table.find.cache_info().currsize <= 4


@given(st.data())
def test_every_spelling_the_manual_allows_is_found(data: st.DataObject) -> None:
    command = data.draw(st.sampled_from([AMPLITUDE, OFFSET, STATE, RUN]))
    parts = []
    for node in re.findall(r"\[:\w+#?\]|[^:\[]+", command.header):
        if node.startswith("[") and not data.draw(st.booleans()):
            continue
        name = node.strip("[:]")
        word = data.draw(st.sampled_from([name.rstrip("#").upper(), short_form(name.rstrip("#"))]))
        word = "".join(data.draw(st.sampled_from([letter, letter.lower()])) for letter in word)
        parts.append(word + (data.draw(st.sampled_from(["", "1", "2", "02"])) if name.endswith("#") else ""))
    header = data.draw(st.sampled_from(["", ":"])) + ":".join(parts)
    assert TABLE.find("", header, query=not isinstance(command, Action)).command is command


@given(st.text(max_size=30), st.booleans())
def test_any_header_is_found_or_refused(header: str, query: bool) -> None:
    codes = []
    try:
        TABLE.find("", header, query=query)
    except ScpiError as error:
        codes.append(error.code)
    assert not set(codes) - {-113, -114}


def test_optional_arguments_are_filled_from_the_left() -> None:
    kinds = (quoted, optional(integer()), optional(integer()), block("u1"))
    data = memoryview(b"ab")
    for arguments, expected in [
        (('"w"', data), ["w", None, None]),
        (('"w"', "3", data), ["w", 3, None]),
        (('"w"', "3", "2", data), ["w", 3, 2]),
    ]:
        *values, received = bind(kinds, arguments)
        assert values == expected
        assert received.tobytes() == b"ab"


@pytest.mark.parametrize(("arguments", "code"), [((), -109), (("1", "2"), -108), (("x",), -104)])
def test_wrong_arguments_are_refused(arguments: tuple[str, ...], code: int) -> None:
    with pytest.raises(ScpiError, match=str(code)):
        bind((integer(),), arguments)


def test_several_takes_the_rest() -> None:
    words = several(keyword("CH1", "CH2"))
    assert bind((words,), ("CH1", "ch2")) == [("CH1", "CH2")]
    with pytest.raises(ScpiError, match="-109"):
        bind((words,), ())
    with pytest.raises(ScpiError, match="-224"):
        bind((words,), ("CH1", "CH7"))


@pytest.mark.parametrize(
    ("reply", "sent"),
    [
        (True, b"1"),
        (np.bool_(0), b"0"),
        (7, b"7"),
        (2.5e10, b"2.5000000000E+10"),
        ("text", b"text"),
        (b"raw", b"raw"),
        (memoryview(b"raw"), b"raw"),
        ([b"#13", memoryview(b"abc")], b"#13abc"),
    ],
)
def test_replies_as_bytes(reply: Any, sent: bytes) -> None:
    assert b"".join(chunks(reply)) == sent


def test_blocks_are_not_copied() -> None:
    data = np.arange(1000, dtype=np.int8)
    header, body = commands.definite_block(data.data)
    assert header == b"#41000"
    assert isinstance(body, memoryview)
    assert np.shares_memory(np.asarray(body), data)


def test_reply_headers_in_long_and_short_form() -> None:
    assert reply_header(AMPLITUDE, (2,), verbose=True) == ":SOURCE2:VOLTAGE"
    assert reply_header(AMPLITUDE, (2,), verbose=False) == ":SOUR2:VOLT"
    assert reply_header(READ_ONLY, (), verbose=True) == ":WFMOUTPRE:NR_PT"
    assert reply_header(IDENTIFY, (), verbose=True) == ""
