"""What a live view sees comes back as it was, and nothing else is taken for it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labctl.runs.live.sight import SIGHT, WISHES, Sight, Wishes, ask_for, read_sight, wishes_in, write_sight

SEEN = Sight(
    ports=(2, 3),
    sample_interval_s=40e-12,
    scale_v=np.array([1e-3, 2e-3]),
    offset_v=np.array([0.1, 0.2]),
    recent=np.array([[[-128, 0, 1], [5, 6, 7]]], np.int8),
    elapsed_s=np.array([0.0, 0.1]),
    level_v=np.full((2, 2), 0.1),
    likeness=np.array([[1.0, np.nan], [0.9, 0.8]]),
    peak_v=np.array([0.1, 0.2]),
    looks=7,
    rate_hz=9.5,
)


@pytest.mark.parametrize("kind", [np.int8, np.int16])
def test_it_comes_back_as_it_was(tmp_path: Path, kind: type) -> None:
    write_sight(tmp_path, Sight(**{**vars(SEEN), "recent": SEEN.recent.astype(kind)}))
    found = read_sight(tmp_path)
    assert found is not None
    assert (found.ports, found.looks, found.rate_hz) == ((2, 3), 7, 9.5)
    assert found.recent.dtype == np.dtype(kind)
    for name in ("recent", "level_v", "likeness", "elapsed_s", "scale_v", "offset_v", "peak_v"):
        assert np.array_equal(getattr(found, name), getattr(SEEN, name), equal_nan=name == "likeness")
    assert [path.name for path in tmp_path.iterdir()] == [SIGHT]


def test_what_a_code_is_and_which_ones_are_at_an_end() -> None:
    assert np.allclose(SEEN.volts[0], [[-0.028, 0.1, 0.101], [0.21, 0.212, 0.214]])
    assert np.allclose(SEEN.ends_v, [[-0.028, 0.227], [-0.056, 0.454]])
    assert SEEN.range_v == pytest.approx((-0.056, 0.454))
    assert SEEN.clipped.tolist() == pytest.approx([1 / 3, 0])


def test_the_levels_are_those_of_the_last_look_however_few_are_kept_of_the_course() -> None:
    brighter = replace(SEEN, recent=np.concatenate([SEEN.recent, SEEN.recent + np.int8(9)]))
    assert np.allclose(brighter.now_v, [[-119, 9, 10], [14, 15, 16]] @ np.full(3, 1 / 3) * SEEN.scale_v + SEEN.offset_v)


def test_a_strangers_file_is_nothing(tmp_path: Path) -> None:
    assert read_sight(tmp_path) is None
    write_sight(tmp_path, SEEN)
    head, _, body = (tmp_path / SIGHT).read_bytes().partition(b"\n")
    header = json.loads(head)
    arrays = header["arrays"]
    for wrong in (
        b"",
        b"\n",
        b"[]\n",
        b"null\n" + body,
        head + b"\n" + body[:-1],
        b"[" * 40_000 + b"\n",
        *(
            json.dumps(header | changed).encode() + b"\n" + body
            for changed in (
                {"ports": [2]},
                {"ports": "no"},
                {"rate_hz": "nan"},
                {"sample_interval_s": 0},
                {"arrays": arrays | {"recent": ["|O8", 1, 2, 3]}},
                {"arrays": arrays | {"recent": ["|i1", 1, 2, 10**12]}},
                {"arrays": arrays | {"recent": ["|i1", 1, 2, -1]}},
                {"arrays": arrays | {"recent": ["|i1", 0, 2, 3]}},
                {"arrays": arrays | {"peak_v": ["<f8"]}},
            )
        ),
    ):
        (tmp_path / SIGHT).write_bytes(wrong)
        assert read_sight(tmp_path) is None, wrong
    (tmp_path / SIGHT).unlink()
    (tmp_path / SIGHT).symlink_to("/etc/hostname")
    assert read_sight(tmp_path) is None


def test_wishes_are_kept_and_nonsense_is_no_wish(tmp_path: Path) -> None:
    assert wishes_in(tmp_path) == Wishes()
    ask_for(tmp_path, Wishes(power="3 mW", drive=False))
    assert wishes_in(tmp_path) == Wishes(power="3 mW", drive=False)
    for nonsense in (b"", b"{", b'{"laser": "on"}', b'{"power": 3}', b"x" * 100_000):
        (tmp_path / WISHES).write_bytes(nonsense)
        assert wishes_in(tmp_path) == Wishes()
