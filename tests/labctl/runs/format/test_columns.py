"""The table of columns, and the tables of shots that are made from it."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.runs.format.columns import ARRAYS, ROWS_DTYPE, SHOTS, SHOTS_DTYPE, in_this_version, same_shots, shot_table
from labctl.runs.format.version import FORMAT_VERSION

COLUMNS: dict[str, Any] = {
    "kind": ["image", "dark"],
    "dataset_index": [5, -1],
    "label": [1, -1],
    "wavelength_nm": [1550.0, 1550.0],
    "group": [0, 1],
}


def number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))


def of_first_version(table: NDArray[Any]) -> NDArray[Any]:
    names = [column.name for column in SHOTS if column.since == "1.0"]
    return table[names].astype([(name, "S9" if name == "kind" else SHOTS_DTYPE[name]) for name in names])


def test_every_column_says_what_it_is_and_is_of_this_version_or_an_earlier_one() -> None:
    for column in (*SHOTS, *ARRAYS):
        assert column.meaning, column.name
        assert number(column.since) <= number(FORMAT_VERSION), column.name
        assert column.name.endswith("_nm") == (column.unit == "nm") or column.name == "wavelength_of_port"
    names = [column.name for column in SHOTS]
    assert len(set(names)) == len(names)


def test_what_came_after_the_first_version_may_be_left_out() -> None:
    table = shot_table(**COLUMNS)
    assert table["index"].tolist() == [0, 1]
    assert table["kind"].tolist() == [b"image", b"dark"]
    assert table["next_label"].tolist() == [-1, -1]
    assert table["time_s"].tolist() == [0, 0]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (COLUMNS | {"label": [1]}, "column label has shape"),
        ({name: values for name, values in COLUMNS.items() if name != "group"}, "without group"),
        (COLUMNS | {"colour": [1, 2]}, "no column of the plan is called colour"),
        (COLUMNS | {"time_s": [1, 2]}, "no column of the plan is called time_s"),
        (COLUMNS | {"kind": ["image", "a kind of many words"]}, "kind of a shot is an ASCII text of at most 16"),
        (COLUMNS | {"kind": ["image", "größer"]}, "kind of a shot is an ASCII text of at most 16"),
    ],
)
def test_what_is_no_plan_is_refused(columns: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        shot_table(**columns)


def test_a_table_of_an_earlier_version_gets_what_came_later() -> None:
    table = shot_table(**COLUMNS)
    found = in_this_version(of_first_version(table))
    assert found.dtype == SHOTS_DTYPE
    assert found.tobytes() == table.tobytes()
    rows = np.zeros(2, [("shot", "<i8"), ("time_s", "<f8"), ("epoch", "<i4"), ("flags", "<i4")])
    assert in_this_version(rows, ROWS_DTYPE).dtype == ROWS_DTYPE
    with pytest.raises(ValueError, match="without dataset_index"):
        in_this_version(table[["index", "kind"]])


def test_a_plan_is_the_same_where_a_stored_one_says_what_it_says() -> None:
    table = shot_table(**COLUMNS, next_label=[3, -1])
    assert same_shots(of_first_version(table), table)
    assert not same_shots(shot_table(**COLUMNS), table)
    assert not same_shots(of_first_version(table), shot_table(**COLUMNS | {"label": [2, -1]}))
