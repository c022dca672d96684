import io
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labctl import datasets
from labctl.datasets import store
from labctl.datasets.cards import card
from labctl.datasets.sequences import group_splits
from labctl.datasets.series import parse_series
from labctl.datasets.vowels import parse_vowels
from labctl.errors import DatasetError

ROW = "0, 0, 0, -3.639, 0.418, -0.670, 1.779, -0.168, 1.627, -0.388, 0.529, -0.874, -0.814, 0"
RATIOS = st.lists(st.integers(-9999, 9999), min_size=10, max_size=10)


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def problem_of(read: Callable[..., object], *arguments: object) -> str:
    """The text of the one error that reading may end in; empty if it succeeds."""
    try:
        read(*arguments)
    except DatasetError as error:
        return str(error)
    return ""


def found(name: str) -> None:
    if problem_of(datasets.path, name):
        pytest.skip(f"LABCTL_DATA does not point to {name}")


@given(
    st.lists(st.tuples(st.booleans(), st.integers(0, 14), st.booleans(), RATIOS, st.integers(0, 10)), min_size=1),
    st.sampled_from([",", ", ", " ", "  ", "\t"]),
    st.sampled_from(["\n", "\r\n", "\n\n"]),
)
def test_rows_come_back_whatever_stands_between(
    rows: list[tuple[bool, int, bool, list[int], int]], comma: str, end: str
) -> None:
    lines = [
        comma.join([str(int(test)), str(speaker), str(int(sex)), *(f"{x / 1000:.3f}" for x in ratios), str(label)])
        for test, speaker, sex, ratios, label in rows
    ]
    read = parse_vowels(end.join(lines).encode(), "vowels")
    np.testing.assert_array_equal(read.features, [[x / 1000 for x in row[3]] for row in rows])
    assert read.labels.tolist() == [row[4] for row in rows]
    assert read.speakers.tolist() == [row[1] for row in rows]
    assert read.training.tolist() == [not row[0] for row in rows]


@given(st.binary(max_size=200) | st.text("0123456789.,- e\n", max_size=200).map(str.encode))
def test_any_bytes_are_vowels_or_the_one_error(content: bytes) -> None:
    problem = problem_of(parse_vowels, content, "vowels")
    assert not problem or problem.startswith("vowels")
    assert "\n" not in problem


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "holds no rows"),
        (ROW + "\n" + ROW[:-3], "line 2: not a vowel"),
        (ROW.replace("0.418", "nan"), "line 1: not a vowel"),
        (ROW.replace("0.418", "1e9"), "line 1: not a vowel"),
        ("2" + ROW[1:], "line 1: not a vowel"),
        (ROW[:-1] + "11", "classes 0..10"),
        (ROW.replace("0, 0, 0", "0, 15, 0"), "speakers are 0..14"),
        ("\n".join([ROW] * 10_001), "more than 10000 rows"),
        (" , ".join(["0"] * 3000), "line 1: not a vowel"),
    ],
)
def test_the_error_says_what_is_wrong_with_the_table(content: str, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        parse_vowels(content.encode(), "vowels")


@given(
    hnp.arrays(
        st.sampled_from([np.int64, np.uint8, np.float32]),
        st.integers(1, 40),
        elements=st.integers(0, 255),
    ),
    st.sampled_from([(-1,), (-1, 1), (1, -1)]),
)
def test_a_series_comes_back_from_any_shape(series: np.ndarray, shape: tuple[int, ...]) -> None:
    read = parse_series(npy(series.reshape(shape)), "series")
    assert read.dtype == np.float64
    np.testing.assert_array_equal(read, series)


@given(st.data())
def test_any_bytes_are_a_series_or_the_one_error(data: st.DataObject) -> None:
    content = bytearray(data.draw(st.just(npy(np.arange(5))) | st.binary(max_size=200)))
    for _ in range(data.draw(st.integers(0, 4)) if content else 0):
        content[data.draw(st.integers(0, min(len(content), 128) - 1))] = data.draw(st.integers(0, 255))
    problem = problem_of(parse_series, bytes(content), "series")
    assert not problem or problem.startswith("series: ")
    assert "\n" not in problem


def header(text: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


@pytest.mark.parametrize(
    "content",
    [
        npy(np.array([{"a": 1}], object)),
        npy(np.array(["text"])),
        npy(np.array([1.0, np.nan])),
        npy(np.zeros((2, 2))),
        npy(np.zeros(0)),
        npy(np.array(1.0)),
        npy(np.zeros(3))[:-4],
        header("{'descr': '<f8', 'fortran_order': False, 'shape': (100000000000,), }"),
        header("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }"),
        header("{'descr': '<f8', 'fortran_order': False, 'shape': (1" + "," * 9000),
        header("(" * 5000),
        header("{'descr': (), 'fortran_order': False, 'shape': (1,), }"),
    ],
)
def test_what_is_no_series_is_refused(content: bytes) -> None:
    with pytest.raises(DatasetError, match=r"^series: "):
        parse_series(content, "series")


@given(st.lists(st.integers(0, 6), min_size=2, max_size=50), st.integers(1, 6), st.integers(0, 9))
def test_no_speaker_is_on_both_sides(speakers: list[int], tested: int, seed: int) -> None:
    groups = np.array(speakers)
    if tested >= len(set(speakers)):
        with pytest.raises(DatasetError, match="leave some on both sides"):
            list(group_splits(groups, test_groups=tested, seed=seed))
        return
    splits = list(group_splits(groups, splits=3, test_groups=tested, seed=seed))
    for train, test in splits:
        assert not set(groups[train]) & set(groups[test])
        assert len(set(groups[test])) == tested
        assert sorted([*train, *test]) == list(range(len(groups)))
    again = list(group_splits(groups, splits=3, test_groups=tested, seed=seed))
    assert all(np.array_equal(one[1], other[1]) for one, other in zip(splits, again, strict=True))


def test_the_table_is_the_same_with_blanks_and_with_commas(tmp_path: Path) -> None:
    found("vowels")
    original = (datasets.path("vowels") / "vowel-context.data").read_text()
    (tmp_path / "vowel").mkdir()
    copy = tmp_path / "vowel" / "vowel-context.data"
    copy.write_text(original.replace(",", " ") + "\n")
    assert all(check.ok for check in datasets.verify("vowels", tmp_path))
    np.testing.assert_array_equal(
        datasets.load_sequences("vowels", directory=tmp_path).sequences, datasets.load_sequences("vowels").sequences
    )
    copy.write_text(original.replace("1", "2", 1))
    with pytest.raises(DatasetError, match="sha256"):
        datasets.load_sequences("vowels", directory=tmp_path)


def test_the_real_vowels() -> None:
    found("vowels")
    read = datasets.load_sequences("vowels")
    assert read.sequences.shape == card("vowels").shape
    four = datasets.load_sequences("vowels", classes=(6, 0, 2, 4))
    assert len(four) == 360
    assert np.bincount(four.labels).tolist() == [90, 0, 90, 0, 90, 0, 90]
    assert np.bincount(four.groups).tolist() == [24] * 15
    assert four.training.sum() == 192
    np.testing.assert_array_equal(read.sequences[four.indices], four.sequences)
    with pytest.raises(DatasetError, match=r"classes \[11\] are not in 'vowels'"):
        datasets.load_sequences("vowels", classes=(0, 11))


def test_the_real_laser() -> None:
    found("santa-fe")
    read = datasets.load_sequences("santa-fe")
    assert read.sequences.shape == card("santa-fe").shape
    assert (read.sequences.min(), read.sequences.max()) == (0, 255)
    assert (read.labels.tolist(), read.groups.tolist(), read.training.tolist()) == ([-1], [-1], [True])


def test_what_was_fetched_is_looked_for_in_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found("santa-fe")
    content = (datasets.path("santa-fe") / "santafe_laser.npy").read_bytes()
    monkeypatch.delenv("LABCTL_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = store.cache_directory() / "santafe"
    folder.mkdir(parents=True)
    (folder / "santafe_laser.npy").write_bytes(content)
    assert datasets.fetch("santa-fe") == folder
    assert len(datasets.load_sequences("santa-fe")) == 1
