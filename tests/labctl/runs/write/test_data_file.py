"""What data.h5 says of itself, to whoever opens it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from labctl.runs.format.columns import ARRAYS, SHOTS
from labctl.runs.format.global_heaps import HEAP
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.writer import RunWriter


def test_every_column_has_its_meaning_and_its_unit(whole: Path) -> None:
    with h5py.File(whole / "data.h5") as file:
        described = file["shots"].attrs
        assert file["shots"].dtype.names == tuple(column.name for column in SHOTS)
        for column in SHOTS:
            assert described[column.name].decode() == column.meaning
            assert described.get(f"{column.name}_units", b"").decode() == column.unit
        for array in ARRAYS:
            assert file[array.name].attrs["long_name"].decode() == array.meaning
            assert file[array.name].attrs.get("units", b"").decode() == array.unit
            assert not array.type or file[array.name].dtype == np.dtype(array.type)


def test_xarray_opens_it_with_names_and_units(whole: Path) -> None:
    with xr.open_dataset(whole / "data.h5", engine="h5netcdf") as found:
        assert dict(found.sizes) == {"shot": 7, "ports": 5, "time": 16, "passes": 2}
        assert found.measured_at_s.attrs["units"] == "s"
        assert found.shots.attrs["label"] == "class, -1 for none"
        assert json.loads(found.attrs["manifest"])["seed"] == 7


def test_its_texts_have_a_fixed_length_and_those_of_plan_and_shards_too(whole: Path) -> None:
    def of_fixed_length(_name: str, item: Any) -> None:
        for name in item.attrs:
            assert name == "DIMENSION_LIST" or not item.attrs.get_id(name).dtype.hasobject or name == "REFERENCE_LIST"

    with h5py.File(whole / "data.h5") as file:
        of_fixed_length("/", file)
        file.visititems(of_fixed_length)
    for path in (whole / "plan.h5", *(whole / "shards").iterdir()):
        assert HEAP not in path.read_bytes()


@pytest.mark.parametrize("size", [60_000, 70_000, 1_000_000])
def test_a_manifest_of_any_length_is_in_it(
    tmp_path: Path,
    small: RunShape,
    plan_for: Callable[[RunShape], NDArray[Any]],
    measure_missing: Callable[[RunWriter], None],
    size: int,
) -> None:
    with RunWriter.create(tmp_path / "run", {"note": "ä" * size}, small, plan_for(small)) as writer:
        measure_missing(writer)
    assert verify_run(tmp_path / "run").data_file == "current"
    with open_run(tmp_path / "run" / "data.h5") as run:
        assert run.manifest["note"] == "ä" * size


def test_the_drive_comes_back_with_its_name_and_amplitude(whole: Path) -> None:
    with open_run(whole) as run, h5py.File(whole / "data.h5") as file:
        assert run.drive is not None
        assert (run.drive.name, run.drive.sample_rate, run.drive.amplitude_vpp) == ("ramp", 25e9, 0.4)
        np.testing.assert_array_equal(run.drive.samples, np.linspace(-1, 1, 50, dtype=np.float32))
        np.testing.assert_array_equal(file["drive/marker"], run.drive.marker)


@pytest.mark.parametrize("name", ["samples", "marker"])
def test_a_changed_drive_is_found(whole: Path, name: str) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        file["drive"][name][3] = not file["drive"][name][3]
    assert verify_run(whole).problems == (f"{whole / 'data.h5'}: /drive differs from the planned one",)


def test_compressed_it_holds_the_same(tmp_path: Path, begin: Callable[..., RunWriter], measure_missing: Any) -> None:
    writer = begin(tmp_path / "run")
    measure_missing(writer)
    with open_run(tmp_path / "run") as run:
        digest = run.digest()
    writer.finish(compression="gzip")
    with open_run(tmp_path / "run" / "data.h5") as run:
        assert run.digest() == digest
