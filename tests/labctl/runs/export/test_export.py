"""Every format read back by its own reader gives what `labctl.open_run` gives; a full disk leaves nothing behind."""

import csv
import json
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import labctl
from labctl.errors import RunError
from labctl.runs.export import FORMATS, Content, Representation, write
from labctl.runs.export.content import BLOCK_BYTES
from labctl.runs.export.file import aside
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.read.variables import Variable
from tests.labctl.runs.conftest import write_whole

LIMITED = Path(__file__).with_name("limited_export.py")

shapes = st.builds(
    RunShape,
    shots=st.integers(1, 6),
    passes=st.sampled_from([((2,),), ((2, 3), (6,))]),
    samples=st.integers(1, 9),
    sample_interval_s=st.sampled_from([20e-12, 1 / 3e10]),
    code_type=st.sampled_from(["int8", "int16"]),
    start_s=st.sampled_from([0.0, -40e-12]),
)
twice = RunShape(4, ((1, 2), (1, 2)), 5, 20e-12, wavelengths_nm=(1550.0, 1551.0))


def export(run: Path, to: str, path: Path, kept: Representation, shots: tuple[int, int] | None = None) -> None:
    with open_run(run) as opened:
        write(Content.of(opened, shots, kept), to, path)


def same(found: Any, expected: xr.DataArray, name: str) -> None:
    values = np.asarray(found)
    if values.dtype.kind in "OU":
        assert values.tolist() == expected.values.tolist()
        return
    assert values.dtype == expected.dtype, name
    np.testing.assert_array_equal(values, expected, err_msg=name)


def by_xarray(open_file: Callable[[Path], xr.Dataset], path: Path, expected: xr.Dataset) -> None:
    with open_file(path) as found:
        assert set(found.data_vars) == set(expected.data_vars)
        assert set(found.coords) == set(expected.coords)
        for name, variable in expected.variables.items():
            assert found[name].dims == variable.dims
            assert found[name].attrs.get("units") == variable.attrs.get("units")
            assert found[name].attrs["long_name"] == variable.attrs["long_name"]
            same(found[name], expected[name], str(name))
        assert json.loads(found.manifest) == json.loads(expected.manifest)
        assert found.complete == expected.complete
        assert found.drive.attrs == expected.drive.attrs


def read_netcdf(path: Path, expected: xr.Dataset) -> None:
    by_xarray(lambda file: xr.open_dataset(file, engine="h5netcdf"), path, expected)


def read_zarr(path: Path, expected: xr.Dataset) -> None:
    by_xarray(lambda file: xr.open_zarr(file, chunks=None, consolidated=True), path, expected)


def read_npz(path: Path, expected: xr.Dataset) -> None:
    with np.load(path, allow_pickle=False) as found:
        units, dimensions = json.loads(str(found["units"])), json.loads(str(found["dimensions"]))
        for name, variable in expected.variables.items():
            same(found[str(name)], expected[name], str(name))
            assert units.get(name) == variable.attrs.get("units")
            assert tuple(dimensions[name]) == variable.dims
        assert json.loads(str(found["manifest"])) == json.loads(expected.manifest)
        assert json.loads(str(found["facts"]))["drive"].items() <= expected.drive.attrs.items()


def read_csv(path: Path, expected: xr.Dataset) -> None:
    text = path.read_text(encoding="utf-8").splitlines()
    told = dict(line[2:].split(": ", 1) for line in text if line.startswith("# "))
    assert json.loads(told["manifest"]) == json.loads(expected.manifest)
    assert json.loads(told["units"])["time_s"] == "s"
    head, *lines = csv.reader(line for line in text if not line.startswith("#"))
    assert len(lines) == expected.sizes["shot"] * expected.sizes["port"]
    first = len(head) - expected.sizes["time"]
    assert [float(time) for time in head[first:]] == expected.time.values.tolist()
    traces = "volts" if "volts" in expected else "frames"
    for number, line in enumerate(lines):
        shot, port = divmod(number, expected.sizes["port"])
        assert [float(value) for value in line[first:]] == expected[traces].values[shot, port].tolist()
        for name, value in zip(head[:first], line, strict=False):
            column = expected[name]
            place = {"shot": shot, "port": port, "pass": int(expected.pass_of_port[port])}
            kept = column.isel({dim: place[str(dim)] for dim in column.dims}).item()
            assert value == str(kept), name


READ = {"netcdf": read_netcdf, "zarr": read_zarr, "npz": read_npz, "csv": read_csv}


def check(shape: RunShape, to: str, kept: Representation, chosen: tuple[int, int] | None, *, finished: bool) -> None:
    with TemporaryDirectory() as folder:
        run, path = write_whole(Path(folder) / "run", shape), Path(folder) / f"out{FORMATS[to]}"
        if not finished:
            (run / "data.h5").unlink()
        export(run, to, path, kept, chosen)
        with labctl.open_run(run) as whole:
            expected = whole.drop_vars("frames" if kept == "volts" else "volts")
            if chosen is not None:
                expected = expected.sel(shot=slice(*chosen))
            READ[to](path, expected.load())


@pytest.mark.parametrize("to", FORMATS)
@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(shapes, st.sampled_from(["volts", "codes"]), st.booleans(), st.tuples(st.integers(0, 7), st.integers(0, 7)))
def test_every_format_gives_the_run_back(
    to: str, shape: RunShape, kept: Representation, finished: bool, some: tuple[int, int]
) -> None:
    chosen = None if min(some) >= shape.shots else (min(some), max(some))
    check(shape, to, kept, chosen, finished=finished)


@pytest.mark.parametrize("to", FORMATS)
def test_ports_at_several_wavelengths_and_code_zero_come_back(to: str) -> None:
    check(twice, to, "codes", None, finished=True)


@pytest.mark.parametrize("to", FORMATS)
def test_a_run_may_have_any_name(to: str, tmp_path: Path) -> None:
    """The name of a folder need not be text, nor fit on one line."""
    run = write_whole(tmp_path / os.fsdecode(b"run\n\xff"), twice)
    export(run, to, tmp_path / "out", "codes")
    assert (tmp_path / "out").exists()


@pytest.mark.parametrize("to", ["netcdf"])
def test_memory_does_not_grow_with_the_run(to: str, tmp_path: Path) -> None:
    run = write_whole(tmp_path / "run", RunShape(60, ((1, 2),), 50_000, 1e-12, "int16"), shots=20)
    with open_run(run) as opened:
        content = Content.of(opened, None, "volts")
        assert content.size > 10 * BLOCK_BYTES
        import_module(f"labctl.runs.export.as_{to}")
        tracemalloc.start()
        try:
            write(content, to, tmp_path / "out")
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert peak < 5 * BLOCK_BYTES


def test_several_may_write_what_gets_one_name_and_the_first_one_counts(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    with ExitStack() as first, ExitStack() as second:
        first.enter_context(aside(path)).write_text("whole")
        second.enter_context(aside(path)).write_text("ha")
        first.close()
        assert path.read_text() == "whole"
        with pytest.raises(RunError, match=r"out\.csv: was made by another program meanwhile"):
            second.close()
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("out.csv", "whole")]


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    run = write_whole(tmp_path / "run", RunShape(20, ((1, 2),), 5_000, 1e-12))
    command = [sys.executable, str(LIMITED), str(run), str(tmp_path)]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(told) == len(FORMATS)
    for line, (to, suffix) in zip(told, FORMATS.items(), strict=True):
        assert line.startswith(f"{tmp_path / 'out'}{suffix}: cannot be written ("), to
        assert line.endswith("or name another place by --out; the run is as it was")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_too_large_a_file_is_refused_before_it_is_begun(tmp_path: Path) -> None:
    with open_run(write_whole(tmp_path / "run")) as run:
        content = Content.of(run, None, "volts")
    huge = Variable("volts", ("shot", "port", "time"), (7, 5, 10**15), np.dtype(np.float64), cast(Any, None), "signal")
    with pytest.raises(
        RunError, match=r"out\.nc: needs 2.8e\+08 GB, .* GB are free: make room, choose some of the --shots, or"
    ):
        write(replace(content, variables=(huge,)), "netcdf", tmp_path / "out.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
