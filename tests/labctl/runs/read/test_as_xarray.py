"""`labctl.open_run`: the whole of a run under names, and no more of it read than is looked at."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import labctl
from labctl.errors import RunError
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run as read_run
from labctl.runs.write.writer import RunWriter

BIG = RunShape(30, ((1, 2), (3,)), 50_000, 1e-12, "int16")
"""Nine megabytes of frames."""
SHOT_BYTES = 3 * 50_000 * 2


def bytes_read() -> int:
    """By this process, from files or the page cache, since it began."""
    return int(Path("/proc/self/io").read_text().split()[1])


counts_bytes = pytest.mark.skipif(not Path("/proc/self/io").exists(), reason="this system does not count bytes read")


def test_a_finished_run_has_names_and_units(whole: Path, small: RunShape) -> None:
    with labctl.open_run(whole) as run, read_run(whole) as plain:
        assert dict(run.sizes) == {"shot": 7, "port": 5, "time": 16, "pass": 2, "drive_sample": 50}
        np.testing.assert_array_equal(run.frames, plain.frames[:])
        np.testing.assert_array_equal(run.volts, plain.volts())
        np.testing.assert_array_equal(run.time, small.time)
        for name in ("kind", "label", "dataset_index", "wavelength_nm", "group", "epoch", "time_s", "flags"):
            assert run.coords[name].dims == ("shot",)
            np.testing.assert_array_equal(run.coords[name], plain.shots[name], err_msg=name)
        for name in ("trigger_offset_s", "clipped", "measured_at_s"):
            np.testing.assert_array_equal(run[name], getattr(plain, name), err_msg=name)
        np.testing.assert_array_equal(run.epoch_of_pass, plain.epoch)
        np.testing.assert_array_equal(run.scale, plain.scale)
        assert plain.drive is not None
        np.testing.assert_array_equal(run.drive, plain.drive.samples)
        assert run.drive.sample_rate == 25e9
        assert (run.drive.attrs["name"], run.drive.amplitude_vpp) == ("ramp", 0.4)
        assert run.frames.dtype == np.int8
        assert (run.volts.units, run.time.units, run.time_s.units, run.wavelength_nm.units) == ("V", "s", "s", "nm")
        assert json.loads(run.manifest)["seed"] == 7
        assert (run.complete, run.shots_planned) == (1, 7)
        assert all(variable.attrs["long_name"] for variable in run.variables.values())
        images = run.frames[run.kind == "image"]
        np.testing.assert_array_equal(images, plain.frames[2:])
        np.testing.assert_array_equal(run.volts.sel(port=6, time=slice(0, 60e-12))[4], plain.volts()[4, 4, 2:6])


def test_a_dataset_that_was_closed_says_so(whole: Path) -> None:
    for data in (labctl.open_run(whole), labctl.open_runs([whole, whole])):
        data.close()
        for name in ("volts", "time_s", "epoch_of_pass", "clipped"):
            with pytest.raises(RunError, match=r"data\.h5: is closed: open it again$"):
                _ = data[name].values


def test_a_run_that_is_going_on(
    tmp_path: Path,
    begin: Callable[..., RunWriter],
    measure_until: Callable[[RunWriter, int], None],
) -> None:
    with begin(tmp_path / "run") as writer:
        with labctl.open_run(tmp_path / "run") as run:
            assert (run.sizes["shot"], run.complete) == (0, 0)
            assert run.volts.values.shape == (0, 5, 16)
        measure_until(writer, 5)
        with labctl.open_run(tmp_path / "run") as run, read_run(tmp_path / "run") as plain:
            assert run.shot.values.tolist() == [0, 1, 2]
            assert run.kind.values.tolist() == ["reference", "dark", "image"]
            np.testing.assert_array_equal(run.volts, plain.volts())
            np.testing.assert_array_equal(run.time_s, plain.shots["time_s"])


def test_a_port_at_several_wavelengths(tmp_path: Path, write_whole: Callable[..., Path]) -> None:
    shape = RunShape(7, ((2, 3), (2, 3)), 16, 20e-12, wavelengths_nm=(1550.0, 1551.0))
    with labctl.open_run(write_whole(tmp_path / "run", shape)) as run:
        assert run.port.values.tolist() == [2, 3, 2, 3]
        np.testing.assert_array_equal(run.frames.sel(port=3), run.frames[:, [1, 3]])
        one = run.isel(port=run.wavelength_of_port == 1551)
        assert one.port.values.tolist() == [2, 3]
        np.testing.assert_array_equal(one.volts.sel(port=2), run.volts[:, 2])


def axis(size: int) -> st.SearchStrategy[Any]:
    """What a person may index a dimension with."""
    place = st.integers(-size, size - 1)
    stretches = st.slices(size).filter(
        lambda one: (one.step or 1) > 0 or range(size)[one]
    )  # an xarray defect otherwise
    return st.one_of(place, stretches, st.lists(place, max_size=2 * size).map(lambda found: np.array(found, np.int64)))


@pytest.fixture(scope="module")
def two_ways(tmp_path_factory: pytest.TempPathFactory, write_whole: Callable[..., Path]) -> Any:
    """The same run read from data.h5 and from the shards, and all of its values in memory."""
    finished, going = (write_whole(tmp_path_factory.mktemp("runs") / name) for name in ("finished", "going"))
    (going / "data.h5").unlink()
    with labctl.open_run(finished) as one, labctl.open_run(going) as other, read_run(finished) as plain:
        yield (one, other), {"frames": plain.frames[:], "volts": plain.volts()}


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.tuples(axis(7), axis(5), axis(16)), st.sampled_from(["frames", "volts"]))
def test_every_index_gives_what_numpy_would(two_ways: Any, key: tuple[Any, ...], name: str) -> None:
    runs, values = two_ways
    expected = values[name]
    for dimension, one in reversed(list(enumerate(key))):
        expected = expected[(slice(None),) * dimension + (one,)]
    for run in runs:
        found = run[name].isel(dict(zip(("shot", "port", "time"), key, strict=True))).values
        np.testing.assert_array_equal(found, expected)


@pytest.fixture(scope="module")
def unequal(tmp_path_factory: pytest.TempPathFactory, write_whole: Callable[..., Path]) -> Any:
    """Three runs of other lengths as one, and their values in memory, not a number beyond the end of each."""
    shapes = [RunShape(shots, ((2, 3), (6,)), samples, 20e-12) for shots, samples in ((40, 5), (3, 16), (25, 9))]
    folder = tmp_path_factory.mktemp("unequal")
    paths = [write_whole(folder / str(number), shape) for number, shape in enumerate(shapes)]
    values = np.full((3, 40, 3, 16), np.nan)
    for number, path in enumerate(paths):
        with read_run(path) as plain:
            values[number, : len(plain.frames), :, : plain.shape.samples] = plain.volts()
    with labctl.open_runs(paths) as runs:
        yield runs, values


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.tuples(axis(3), axis(40), axis(3), axis(16)))
def test_what_a_shorter_run_does_not_have_is_not_a_number(unequal: Any, key: tuple[Any, ...]) -> None:
    runs, expected = unequal
    for dimension, one in reversed(list(enumerate(key))):
        expected = expected[(slice(None),) * dimension + (one,)]
    found = runs.volts.isel(dict(zip(("run", "shot", "port", "time"), key, strict=True))).values
    np.testing.assert_array_equal(found, expected)


def test_runs_that_begin_differently_after_the_trigger_share_the_time_from_their_first_sample(
    tmp_path: Path, write_whole: Callable[..., Path]
) -> None:
    starts = {"single": 0.0, "burst": 200e-9, "another": 200e-9}
    paths = [
        write_whole(tmp_path / name, RunShape(3, ((2,),), 5, 20e-12, start_s=start)) for name, start in starts.items()
    ]
    with labctl.open_runs(paths) as runs:
        np.testing.assert_allclose(runs.time, 20e-12 * np.arange(5), rtol=1e-6)
        assert runs.time.long_name == "time after the frame's first sample"
    with labctl.open_runs(paths[1:]) as runs:
        assert runs.time.values[0] == 200e-9
        assert runs.time.long_name.startswith("time after the trigger")


def test_many_shots_beyond_the_end_of_a_run_are_not_a_number(unequal: Any) -> None:
    runs, values = unequal
    odd = np.arange(40) % 2 == 1
    late = runs.isel(shot=odd).volts.sel(time=slice(6 * 20e-12, None))
    np.testing.assert_array_equal(late.values, values[:, odd, :, 6:])
    assert np.isfinite(late.mean())


def test_many_shots_without_a_sample_are_nothing(tmp_path: Path, write_whole: Callable[..., Path]) -> None:
    with labctl.open_run(write_whole(tmp_path / "run", RunShape(40, ((2, 3),), 5, 20e-12))) as run:
        odd = run.isel(shot=run.shot.values % 2 == 1)
        assert odd.volts.sel(time=slice(1e-9, None)).values.shape == (20, 2, 0)


@counts_bytes
@pytest.mark.parametrize("kept", [True, False], ids=["data.h5", "shards"])
def test_a_slice_reads_only_what_it_needs(tmp_path: Path, write_whole: Callable[..., Path], kept: bool) -> None:
    directory = write_whole(tmp_path / "run", BIG)
    if not kept:
        (directory / "data.h5").unlink()
    labctl.open_run(directory).close()
    before = bytes_read()
    with labctl.open_run(directory) as run:
        opened = bytes_read() - before
        trace = run.volts.sel(shot=11, port=3, time=slice(0, 1e-9)).values
        read = bytes_read() - before
    assert trace.shape == (1001,)
    if kept:
        assert opened < SHOT_BYTES
        assert read < 6 * SHOT_BYTES  # a chunk holds three shots
    else:
        assert opened < 7 * SHOT_BYTES  # the first shard of each pass, for its scales
        assert read < 14 * SHOT_BYTES


def test_what_is_no_run_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="not a run directory"):
        labctl.open_run(tmp_path)


def test_without_xarray_one_line_says_what_to_install(whole: Path) -> None:
    code = (
        "import sys; sys.modules['xarray'] = None; import labctl; from labctl.errors import RunError\n"
        "try: labctl.open_run(sys.argv[1])\n"
        "except RunError as error: print(error)"
    )
    told = subprocess.run([sys.executable, "-c", code, whole], capture_output=True, text=True, check=True).stdout
    assert 'pip install "photonic-labctl[data]"' in told
    assert told.count("\n") == 1


def test_importing_labctl_imports_nothing_heavy() -> None:
    code = "import sys, labctl; print(sorted({'numpy', 'h5py', 'xarray', 'pandas', 'pydantic'} & set(sys.modules)))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert told == "[]\n"
