"""The reader of program messages: every byte counts, and no byte stops it."""

from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.scpi.messages import LONGEST_TEXT, Malformed, Message, MessageReader, Unit


def feed(reader: MessageReader, stream: bytes, sizes: Iterable[int] = ()) -> list[Message]:
    """Hand `stream` over in chunks of `sizes`, the rest at once; never more than there is room for."""
    messages = []
    cuts = iter(sizes)
    while stream:
        room = reader.buffer()
        count = min(len(room), len(stream), next(cuts, len(stream)))
        room[:count] = stream[:count]
        stream = stream[count:]
        messages += reader.received(count)
    return messages


def read(stream: bytes) -> list[Message]:
    return feed(MessageReader(), stream)


def command(header: str, *arguments: str | bytes) -> Unit:
    values = tuple(memoryview(value) if isinstance(value, bytes) else value for value in arguments)
    return Unit(header.removesuffix("?"), header.endswith("?"), values)


def codes(message: Message) -> list[int]:
    return [unit.code for unit in message.units if isinstance(unit, Malformed)]


@pytest.mark.parametrize(
    ("stream", "messages"),
    [
        (b"*IDN?\n", [[command("*IDN?")]]),
        (b"  *idn?  \r\n", [[command("*idn?")]]),
        (b":CLOCk:SRATe 25e9;*OPC?\n", [[command(":CLOCk:SRATe", "25e9"), command("*OPC?")]]),
        (b"CLOC:SRAT? MAX\n", [[command("CLOC:SRAT?", "MAX")]]),
        (b"A\t1 , 2,,3\nB\n", [[command("A", "1", "2", "", "3")], [command("B")]]),
        (b"A 'x;\"y',\"a''b;,:#15\"\n", [[command("A", "'x;\"y'", "\"a''b;,:#15\"")]]),
        (b'A "say ""hi""";B\n', [[command("A", '"say ""hi"""'), command("B")]]),
        (b"ROUT:CLOS (@1!2,2!3),7\n", [[command("ROUT:CLOS", "(@1!2,2!3)", "7")]]),
        (b'A ("x)",1\n', [[command("A", '("x)"', "1")]]),
        (b"A #H1F,#b01,#Q17,x#13\n", [[command("A", "#H1F", "#b01", "#Q17", "x#13")]]),
        (b"\n\r\n;;\n ; A;\n", [[command("A")]]),
        (b"A #15a\n;\"'\nB\n", [[command("A", b"a\n;\"'")], [command("B")]]),
        (b"A #15hello\r\nB\n", [[command("A", b"hello")], [command("B")]]),
        (b"A #15hello", [[command("A", b"hello")]]),
        (b"A #15hello*OPC?\n", [[command("A", b"hello")], [command("*OPC?")]]),
        (b"A #15hello;B 1\n", [[command("A", b"hello"), command("B", "1")]]),
        (b'A "f",#15hello,2,#11;;*OPC?\n', [[command("A", '"f"', b"hello", "2", b";"), command("*OPC?")]]),
        (b"A #10\nB\n", [[command("A", b"")], [command("B")]]),
        (b"A? #9000000008abcdefg\n\n", [[command("A?", b"abcdefg\n")]]),
        (b"A #A0000000003abc\n", [[command("A", b"abc")]]),
        (b"A #0a;b,c\nB\n", [[command("A", b"a;b,c")], [command("B")]]),
    ],
)
def test_messages(stream: bytes, messages: list[list[Unit]]) -> None:
    assert [list(message.units) for message in read(stream)] == messages
    assert [list(message.units) for message in feed(MessageReader(), stream, [3])] == messages


@pytest.mark.parametrize(
    ("stream", "code"),
    [
        (b'A "x\n', -102),
        (b"A don't\n", -102),
        (b"A (it's)\n", -102),
        (b'A"b c"\n', -102),
        (b",1\n", -102),
        (b" #15hello\n", -102),
        (b"A ( #11x\n", -102),
        (b"A #2zz\n", -161),
        (b"A #91\n", -161),
        (b"A #AB\n", -161),
        (b"A #A9999999999\n", -161),
    ],
)
def test_malformed_messages_leave_the_link_in_step(stream: bytes, code: int) -> None:
    (before, wrong, after) = read(b"A 1\n" + stream + b"*IDN?\n")
    assert codes(wrong) == [code]
    assert before.units == (command("A", "1"),)
    assert after.units == (command("*IDN?"),)
    assert all(not unit.query and not unit.arguments for unit in wrong.units if isinstance(unit, Malformed))


def test_units_before_a_malformed_one_are_kept() -> None:
    (message,) = read(b"A 1;B #2zz;C\n")
    assert message.units[0] == command("A", "1")
    assert codes(message) == [-161]
    (message,) = read(b'A 1;B "x;C\n')
    assert message.units[0] == command("A", "1")
    assert codes(message) == [-102]


def test_queries() -> None:
    ask, tell = read(b"A 1;B?\nA 1\n")
    assert ask.queries
    assert not tell.queries


def test_a_newline_behind_a_delivered_block_is_no_message() -> None:
    reader = MessageReader()
    assert len(feed(reader, b"A #15hello")) == 1
    assert feed(reader, b"\r") == []
    assert feed(reader, b"\n") == []
    assert feed(reader, b"B\n") == [Message((command("B"),))]


def test_a_large_block_is_received_in_place() -> None:
    samples = np.arange(1_000_000, dtype="<f4")
    reader = MessageReader()
    assert feed(reader, b'WLIS:WAV:DATA "a",#74000000') == []
    assert len(reader.buffer()) >= samples.nbytes
    (message,) = feed(reader, samples.tobytes() + b";*OPC?\n")
    block = message.units[0].arguments[1]
    assert isinstance(block, memoryview)
    np.testing.assert_array_equal(np.frombuffer(block, "<f4"), samples)
    assert message.units[1] == command("*OPC?")


def test_clear_forgets_half_a_message() -> None:
    reader = MessageReader()
    for half in (b"A 1,", b"A #3100half", b"A #15hello,", b'A "'):
        assert feed(reader, half) == []
        reader.clear()
        assert feed(reader, b"B\n") == [Message((command("B"),))]


def test_end_completes_a_message_without_a_newline() -> None:
    reader = MessageReader()
    assert reader.end() == []
    assert feed(reader, b"*IDN?") == []
    assert reader.end() == [Message((command("*IDN?"),))]
    assert feed(reader, b"A #0abc") == []
    assert reader.end() == [Message((command("A", b"abc"),))]
    for half in (b"A #15hell", b"A #2", b"A #21"):
        assert feed(reader, half) == []
        assert codes(*reader.end()) == [-161]
    assert feed(reader, b"B") == []
    assert reader.end() == [Message((command("B"),))]


def test_long_text() -> None:
    numbers = ",".join(map(str, range(100_000)))
    (message,) = read(f"A {numbers}\n".encode())
    assert message.units[0].arguments[-1] == "99999"
    reader = MessageReader()
    (message,) = feed(reader, b"x" * LONGEST_TEXT)
    assert codes(message) == [-102]
    assert feed(reader, b"\nB\n") == [Message((command("B"),))]


words = st.from_regex(r"\A[A-Za-z*:][A-Za-z0-9:]{0,12}\??\Z").map(lambda text: (text.encode(), text))
plain = st.from_regex(r"\A[-+.A-Za-z0-9]{1,9}\Z").map(lambda text: (text.encode(), text))
quoted = st.text(st.characters(codec="latin-1", exclude_characters='"\n')).map(lambda text: f'"{text}"')
quoted_words = quoted.map(lambda text: (text.encode("latin-1"), text))
blocks = st.binary(max_size=300) | st.integers(70_000, 140_000).map(lambda size: (b'\n";#15' * size)[:size])


@st.composite
def units(draw: st.DrawFn, *, block_last: bool = False) -> tuple[bytes, Unit]:
    """The bytes of a unit and what they mean; where blocks are asked for, the last argument is one."""
    header, name = draw(words)
    arguments = draw(st.lists(plain | quoted_words, max_size=3))
    values: list[str | bytes] = [value for _, value in arguments]
    sent = [raw for raw, _ in arguments]
    if block_last:
        content = draw(blocks)
        length = str(len(content)) if draw(st.booleans()) else f"{len(content):09d}"
        sent.append(f"#{len(length)}{length}".encode() + content)
        values.append(content)
    return header + (b" " if sent else b"") + b",".join(sent), command(name, *values)


@st.composite
def streams(draw: st.DrawFn) -> tuple[bytes, list[Unit]]:
    """A stream of messages; those that end in a block end in any of the ways clients end them."""
    stream, meaning = b"", []
    for _ in range(draw(st.integers(1, 6))):
        for raw, unit in draw(st.lists(units(), max_size=2)):
            stream += raw + b";"
            meaning.append(unit)
        block = draw(st.booleans())
        raw, unit = draw(units(block_last=block))
        stream += raw + draw(st.sampled_from([b"\n", b"\r\n", b"", b";\n"] if block else [b"\n", b"\r\n", b" \n"]))
        meaning.append(unit)
    return stream, meaning


@given(streams(), st.lists(st.integers(1, 90_000) | st.integers(1, 9), max_size=200))
def test_any_split_gives_the_same_units(sent: tuple[bytes, list[Unit]], sizes: list[int]) -> None:
    stream, meaning = sent
    assert [unit for message in feed(MessageReader(), stream, sizes) for unit in message.units] == meaning


@given(st.lists(units(), min_size=1, max_size=4), st.lists(st.integers(1, 9)))
def test_any_split_gives_the_same_messages_of_text(sent: list[tuple[bytes, Unit]], sizes: list[int]) -> None:
    stream = b"\n".join(raw for raw, _ in sent) + b"\n"
    assert feed(MessageReader(), stream, sizes) == [Message((unit,)) for _, unit in sent]


scraps = st.sampled_from([*(b"#,#1,#29,#0,#A,#9999,\",',;, ,(,),A,?").split(b","), b",", b"\n"])


@given(st.lists(scraps | st.binary(max_size=5)).map(b"".join), st.lists(st.integers(1, 9)))
def test_garbage_neither_raises_nor_stops_the_reader(garbage: bytes, sizes: list[int]) -> None:
    reader = MessageReader()
    for message in feed(reader, garbage, sizes):
        assert message.units
        assert all(unit.header or isinstance(unit, Malformed) for unit in message.units)
    reader.end()
    assert feed(reader, b"*IDN?\n") == [Message((command("*IDN?"),))]


@given(st.lists(scraps, max_size=30).map(b"".join), st.integers(1, 9))
def test_garbage_means_the_same_however_it_is_split(garbage: bytes, size: int) -> None:
    garbage = garbage.replace(b"#", b"$#")  # no blocks: behind those, a pause may end a message
    assert feed(MessageReader(), garbage, [size] * 1000) == read(garbage)
