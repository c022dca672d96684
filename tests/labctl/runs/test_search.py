"""The words by which runs are found, against a table of runs."""

import sqlite3
from contextlib import closing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.errors import UsageError
from labctl.runs.search import LONGEST, MOST_NESTED, condition, words_in

RUNS: dict[str, dict[str, list[str | float]]] = {
    "a-image": {"protocol": ["image-readout"], "images": [300.0], "window": [1e-9], "tag": ["good", "shown twice"]},
    "b-image": {"protocol": ["image-readout"], "images": [100.0, 500.0], "accuracy": [0.8, 0.93]},
    "d-night": {"started": ["2026-11-29T16:50:11+00:00"]},
    "e-night": {"started": ["2026-11-30T00:00:00+00:00"]},
    "c-scene": {"protocol": ["dynamic-scene"], "tag": ["50% off", "007"], "note": ["the fibre was touched"]},
}
KEYS = frozenset(key for facts in RUNS.values() for key in facts)


def holds_text(key: str) -> bool:
    return any(isinstance(value, str) for facts in RUNS.values() for value in facts.get(key, ()))


def found(words: str) -> str:
    """First letters of the runs that are found."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(
            "CREATE TABLE run (name, words); CREATE TABLE fact (run, key, number, text COLLATE NOCASE)"
        )
        for name, facts in RUNS.items():
            text = " ".join(str(value) for values in facts.values() for value in values)
            database.execute("INSERT INTO run VALUES (?, ?)", [name, f" {' '.join(words_in(f'{name} {text}'))}"])
            for key, value in [(key, value) for key, values in facts.items() for value in values]:
                pair = (value, None) if isinstance(value, float) else (None, value)
                database.execute("INSERT INTO fact VALUES (?, ?, ?, ?)", [name, key, *pair])
        sql, values = condition(words, KEYS, holds_text)
        rows = database.execute(f"SELECT name FROM run WHERE {sql} ORDER BY name", values)  # noqa: S608 -- by `condition`
        return "".join(name[0] for (name,) in rows)


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("", "abcde"),
        ("image", "ab"),
        ("IMAGE-readout", "ab"),
        ("mage", ""),
        ("scene touched", "c"),
        ("protocol = image-readout and images >= 300 and tag = good", "a"),
        ("protocol = image-readout images >= 300", "ab"),
        ("images > 300", "b"),
        ("images != 300", "bcde"),
        ("accuracy > 0.9", "b"),
        ("window = 1 ns", "a"),
        ("window < 1 us and window >= 0.5 ns", "a"),
        ("tag = shown twice", "a"),
        ("tag = 'shown twice' or accuracy < 0.9", "ab"),
        ("tag ~ 50%", "c"),
        ("tag ~ %", "c"),
        ("note ~ fibre was", "c"),
        ("tag = 007", "c"),
        ("tag = '007'", "c"),
        ("tag != 007", "abde"),
        ("Tag = GOOD", "a"),
        ("not tag = good", "bcde"),
        ("not (tag = good or accuracy > 0)", "cde"),
        ('"or"', ""),
        ("started = 2026-11-29", "d"),
        ("started <= 2026-11-29", "d"),
        ("started > 2026-11-29", "e"),
        ("started < 2026-11-30", "d"),
        ("started >= 2026-11-30", "e"),
        ("started != 2026-11-29", "abce"),
        ("started >= 2026-11-29T16:50:11Z", "de"),
        ("started = 2026-11-29 16:50:11", "d"),
        ("started <= 2026-11-29T17:50:11+01:00", "d"),
        ("started > 2026-11-29T16:50:11", "e"),
        ("started < 2026-11-29T18:30+02:00", ""),
        ("started < 2026-11-30T02:00:01+02:00", "de"),
        ("started ~ 2026-11", "de"),
        ("not " * MOST_NESTED + "image", "ab"),
        ("not (x " * (MOST_NESTED // 2) + ")" * (MOST_NESTED // 2), "abcde"),
    ],
)
def test_words_and_what_they_find(words: str, names: str) -> None:
    assert found(words) == names


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("acuracy > 0.9", "acuracy: no run here has that: did you mean accuracy?"),
        ("images >", "images >: a value is missing"),
        ("images > many", "images > many: images is a number"),
        ("accuracy > 80 %", "accuracy > 80 %: accuracy is a number"),
        ("started > yesterday", "started > yesterday: is not a date: write it like 2026-11-21 or 2026-11-21T09:15"),
        ("started = 9999-12-31", "is not a date"),
        ("started = 0001-01-01T00:00+14:00", "is not a date"),
        ("(image", "a bracket is not closed"),
        ("image)", "): is not understood here"),
        ("and image", "and: comes where a word or a comparison is missing"),
        ("image or", "the end: comes where"),
        ("= 3", "=: comes where"),
        ("note ~ 'fibre", "a quotation mark is missing"),
        ("x" * (LONGEST + 1), f"write {LONGEST} at most"),
        ("not " * (MOST_NESTED + 1) + "x", f"more than {MOST_NESTED} brackets and not"),
    ],
)
def test_what_is_not_understood_is_one_line(words: str, message: str) -> None:
    with pytest.raises(UsageError) as refused:
        condition(words, KEYS, holds_text)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@given(st.text(alphabet=st.sampled_from(list("ab 1.%()'\"=<>!~_;-")) | st.characters(), max_size=60))
def test_any_words_are_a_search_or_refused(words: str) -> None:
    try:
        condition(words, KEYS, holds_text)
    except UsageError:
        return
    assert set(found(words)) <= set("abcde")
