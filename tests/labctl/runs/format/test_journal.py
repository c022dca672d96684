import json
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.errors import RunError
from labctl.runs.format.journal import Entry, JournalFile, read_journal

numbers = st.integers(0, 2**40)
entries = st.builds(
    Entry,
    shard=numbers,
    pass_index=numbers,
    passes=numbers,
    first=numbers,
    shots=st.integers(-(2**40), 2**40),
    count=numbers,
    sha256=st.text("0123456789abcdef", min_size=64, max_size=64),
    discarded=st.text(),
)


def lines(path: Path, count: int) -> list[Entry]:
    written = [Entry(n, 0, 1, 10 * n, 10, 10, f"{n:064x}") for n in range(count)]
    with JournalFile(path) as journal:
        for entry in written:
            journal.append(entry)
    return written


@given(entries)
def test_a_line_comes_back(entry: Entry) -> None:
    assert entry.encode().count(b"\n") == 1
    assert Entry.decode(entry.encode()) == entry


@given(entries)
def test_the_checksum_can_be_computed_with_any_json_and_zip_library(entry: Entry) -> None:
    values = json.loads(entry.encode())
    assert list(values)[-1] == "crc"
    crc = values.pop("crc")
    assert crc == f"{zlib.crc32(json.dumps(values).encode()):08x}"


@given(entries, st.data())
def test_no_flipped_bit_goes_unnoticed(entry: Entry, data: st.DataObject) -> None:
    line = bytearray(entry.encode()[:-1])
    line[data.draw(st.integers(0, len(line) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    with pytest.raises(ValueError, match=r"checksum|whole line"):
        Entry.decode(bytes(line))


def test_a_line_without_a_key_is_refused() -> None:
    body = b'{"shard": 1}'
    with pytest.raises(ValueError, match="lacks 'pass'"):
        Entry.decode(body[:-1] + f', "crc": "{zlib.crc32(body):08x}"}}'.encode())


@given(st.integers(1, 200))
def test_a_torn_last_line_is_tolerated_wherever_it_is_torn(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    path = tmp_path_factory.mktemp("torn") / "journal.jsonl"
    written = lines(path, 3)
    whole = path.read_bytes()
    last = len(written[-1].encode())
    path.write_bytes(whole[: len(whole) - min(cut, last)])
    journal = read_journal(path)
    assert not journal.problems
    assert list(journal.entries) == (written if cut == 1 else written[:2])  # only its newline is missing
    with JournalFile(path) as mended:
        mended.append(written[-1])
    assert [entry.shard for entry in read_journal(path).entries] == ([0, 1, 2, 2] if cut == 1 else [0, 1, 2])
    assert not read_journal(path).problems


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_wrong_checksum_is_a_problem_wherever_it_is(tmp_path: Path, number: int) -> None:
    path = tmp_path / "journal.jsonl"
    written = lines(path, 3)
    text = path.read_bytes().splitlines(keepends=True)
    text[number] = text[number].replace(b'"count": 10', b'"count": 11')
    path.write_bytes(b"".join(text))
    journal = read_journal(path)
    assert journal.problems == (f"journal.jsonl line {number + 1}: checksum is wrong",)
    assert list(journal.entries) == [entry for entry in written if entry.shard != number]


def test_a_torn_line_in_the_middle_is_a_problem(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    lines(path, 3)
    path.write_bytes(path.read_bytes().replace(b'{"shard": 1', b"", 1))
    assert read_journal(path).problems == ("journal.jsonl line 2: not a whole line",)


def test_a_missing_journal_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"journal\.jsonl: cannot be read"):
        read_journal(tmp_path / "journal.jsonl")
    with pytest.raises(RunError, match=r"nowhere: is gone, .*`labctl resume`"):
        JournalFile(tmp_path / "nowhere" / "journal.jsonl")
