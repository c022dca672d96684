"""The last shots of a run come back as they were, and nothing else is taken for them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.runs.live.glimpse import GLIMPSE, Glimpse, read_glimpse, write_glimpse

SEEN = Glimpse(
    pass_index=1,
    shots=np.array([4, 5]),
    time_s=np.array([0.1, 0.2]),
    codes=np.array([[[-128, 0, 1]], [[5, 6, 7]]], np.int8),
    scale_v=np.array([1e-3]),
    offset_v=np.array([0.1]),
)


@pytest.mark.parametrize("kind", [np.int8, np.int16])
def test_they_come_back_as_they_were(tmp_path: Path, kind: type) -> None:
    write_glimpse(tmp_path, replace(SEEN, codes=SEEN.codes.astype(kind)))
    found = read_glimpse(tmp_path)
    assert found is not None
    assert found.pass_index == 1
    assert found.codes.dtype == np.dtype(kind)
    for name in ("shots", "time_s", "codes", "scale_v", "offset_v"):
        assert np.array_equal(getattr(found, name), getattr(SEEN, name))


@pytest.mark.parametrize(
    "wrong",
    [
        {"shots": np.array([4])},
        {"shots": np.array([4.0, 5.0])},
        {"time_s": np.array([0.1, np.nan])},
        {"codes": np.zeros((2, 3), np.int8)},
        {"codes": np.zeros((2, 1, 3))},
        {"codes": np.zeros((0, 1, 3), np.int8), "shots": np.array([], np.int64), "time_s": np.array([])},
        {"scale_v": np.array([np.inf])},
        {"offset_v": np.array([0.1, 0.2])},
        {"pass_index": "first"},
    ],
)
def test_what_no_run_can_have_written_is_nothing(tmp_path: Path, wrong: dict[str, Any]) -> None:
    write_glimpse(tmp_path, replace(SEEN, **wrong))
    assert read_glimpse(tmp_path) is None


@given(st.data())
def test_a_strangers_file_is_nothing_or_well_formed(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("run")
    write_glimpse(folder, SEEN)
    content = bytearray((folder / GLIMPSE).read_bytes())
    for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=4)):
        content[place] = data.draw(st.integers(0, 255))
    (folder / GLIMPSE).write_bytes(content[: data.draw(st.integers(0, len(content)))])
    found = read_glimpse(folder)
    if found is not None:
        assert found.codes.shape[:2] == (found.shots.size, found.scale_v.size)
        assert found.time_s.size == found.shots.size
