import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.errors import RunError
from labctl.runs.format.shape import RunShape
from labctl.runs.format.version import FORMAT_VERSION
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter


def test_plain_h5py_reads_a_data_file(whole: Path, small: RunShape) -> None:
    with h5py.File(whole / "data.h5") as file:
        assert file["frames"].shape == (7, 5, 16)
        assert file["frames"].dtype == np.int8
        assert not file["frames"].is_virtual
        assert file["frames"].chunks == (7, 5, 16)
        assert file["shots"].dtype.names[:4] == ("index", "kind", "dataset_index", "label")
        assert file["shots"]["kind"][:3].tolist() == [b"reference", b"dark", b"image"]
        assert file["trigger_offset_s"].shape == file["clipped"].shape == (7, 5)
        np.testing.assert_array_equal(file["scale"][:], [1e-3] * 4 + [2e-3])
        np.testing.assert_array_equal(file["offset"][:], [0.05] * 5)
        np.testing.assert_array_equal(file["ports"][:], [2, 3, 4, 5, 6])
        np.testing.assert_array_equal(file["pass_of_port"][:], [0, 0, 0, 0, 1])
        np.testing.assert_array_equal(file["time"][:], small.time)
        assert file["drive"].attrs["sample_rate"] == 25e9
        assert file["drive/samples"].shape == file["drive/marker"].shape == (50,)
        assert file.attrs["format_version"].decode() == FORMAT_VERSION
        assert json.loads(file.attrs["manifest"])["seed"] == 7
        assert bool(file.attrs["complete"])
        axes = file["frames"].dims
        assert [axis.keys() for axis in axes] == [["shot"], ["port"], ["sample"]]
        assert [axis[0].name for axis in axes] == ["/shot", "/ports", "/time"]
        assert all(not isinstance(item, h5py.Group) for name, item in file.items() if name != "drive")


def test_chunks_hold_whole_shots_of_about_a_megabyte(tmp_path: Path, write_whole: Callable[..., Path]) -> None:
    large = RunShape(30, ((1, 2),), 50_000, 1e-12, "int16")
    with h5py.File(write_whole(tmp_path / "run", large) / "data.h5") as file:
        assert file["frames"].chunks == (5, 2, 50_000)
    with open_run(tmp_path / "run") as run, open_run(tmp_path / "run" / "data.h5") as data:
        assert run.digest() == data.digest()
    assert not verify_run(tmp_path / "run").problems


def test_a_run_is_read_while_it_is_written(
    tmp_path: Path,
    begin: Callable[..., RunWriter],
    measure_until: Callable[[RunWriter, int], None],
) -> None:
    with begin(tmp_path / "run") as writer:
        with pytest.raises(RunError, match="not a run directory"):
            open_run(tmp_path)
        measure_until(writer, 5)
        with open_run(tmp_path / "run") as run:
            assert (run.done, run.complete, len(run.frames)) == ((7, 3), False, 3)
            assert run.frames.dtype == np.int8
            assert run.shots["index"].tolist() == [0, 1, 2]
            np.testing.assert_array_equal(np.asarray(run.frames), run.frames[:])
            np.testing.assert_array_equal(run.frames[1], run.frames[:][1])
            np.testing.assert_array_equal(run.frames[1:, 4, ::2], run.frames[:][1:, 4, ::2])
            np.testing.assert_array_equal(run.frames[..., 0], run.frames[:][..., 0])
            np.testing.assert_array_equal(run.frames[[0, 2]], run.frames[:][[0, 2]])
            np.testing.assert_array_equal(run.frames[np.array([True, False, True])], run.frames[:][[0, 2]])


def test_both_ways_of_reading_agree(whole: Path) -> None:
    with open_run(whole / "data.h5") as data:
        (whole / "data.h5").rename(whole / "elsewhere.h5")
        with open_run(whole) as shards:
            assert data.digest() == shards.digest()
            assert (data.done, data.complete, data.ports) == (shards.done, shards.complete, shards.ports)
            assert data.manifest == shards.manifest
            assert data.shots.dtype == shards.shots.dtype
            assert data.shots.tobytes() == shards.shots.tobytes()
            for name in ("trigger_offset_s", "clipped", "epoch", "measured_at_s", "scale", "offset", "time"):
                np.testing.assert_array_equal(getattr(data, name), getattr(shards, name), err_msg=name)
            np.testing.assert_array_equal(data.volts([0, 3]), shards.volts([0, 3]))
            assert data.drive is not None
            assert shards.drive is not None
            np.testing.assert_array_equal(data.drive.samples, shards.drive.samples)


def test_volts(whole: Path) -> None:
    with open_run(whole) as run:
        np.testing.assert_allclose(run.volts()[:, 4], 2e-3 * run.frames[:, 4].astype(float) + 0.05)
        assert run.volts(slice(2)).shape == (2, 5, 16)


def test_a_data_file_is_enough(tmp_path: Path, whole: Path) -> None:
    shutil.rmtree(whole / "shards")
    with open_run(whole) as run:
        assert (run.complete, run.done) == (True, (7, 7))
    (whole / "journal.jsonl").unlink()
    with open_run(whole) as run:
        assert run.complete
    shutil.copy(whole / "data.h5", tmp_path / "copy.h5")
    with open_run(str(tmp_path / "copy.h5")) as run:
        assert run.complete
        assert run.path == tmp_path / "copy.h5"


def test_what_was_closed_is_not_called_damaged(whole: Path) -> None:
    with open_run(whole) as run:
        frames = run.frames
    looks: list[Callable[[], Any]] = [
        lambda: frames[0],
        lambda: frames[[0, 2]],
        lambda: run.shots,
        lambda: run.clipped,
        lambda: run.scale,
        lambda: run.drive,
        run.volts,
        run.digest,
    ]
    for look in looks:
        with pytest.raises(RunError, match=r"data\.h5: is closed: open it again$"):
            look()


def test_a_run_without_a_drive(
    tmp_path: Path,
    small: RunShape,
    plan_for: Callable[[RunShape], NDArray[Any]],
    measure_missing: Callable[[RunWriter], None],
) -> None:
    with RunWriter.create(tmp_path / "run", {}, small, plan_for(small), durability=Durability(50)) as writer:
        measure_missing(writer)
    with open_run(tmp_path / "run") as run:
        assert run.drive is None
    assert not verify_run(tmp_path / "run").problems


@pytest.mark.parametrize("version", ["1.3", "2.0"])
def test_versions_of_the_data_file(whole: Path, version: str) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        file.attrs["format_version"] = version
    if version == "1.3":
        open_run(whole).close()
    else:
        with pytest.raises(RunError, match=r"data\.h5: format '2\.0'"):
            open_run(whole)


def test_a_data_file_that_is_not_whole_is_named(whole: Path, tmp_path: Path) -> None:
    data = whole / "data.h5"
    image = data.read_bytes()
    data.write_bytes(image[:500])
    with pytest.raises(RunError, match=r"data\.h5: not a whole data file .*--rebuild"):
        open_run(whole)
    with pytest.raises(RunError, match=r"data\.h5: not a whole data file"):
        open_run(data)
    data.write_bytes(image)
    with h5py.File(data, "r+") as file:
        del file["epoch"]
    with open_run(whole) as run, pytest.raises(RunError, match="not a whole data file"):
        _ = run.epoch
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(RunError, match="not a whole data file"):
        open_run(tmp_path / "other.h5")
    with h5py.File(data, "r+") as file:
        del file.attrs["evidence"]
    with pytest.raises(RunError, match="not a whole data file"):
        open_run(whole)


def test_frames_that_are_not_in_the_data_file_are_told_in_one_line(whole: Path) -> None:
    data = whole / "data.h5"
    with h5py.File(data) as file:
        place = file["frames"].id.get_chunk_info(0).byte_offset
    image = data.read_bytes()
    named = place.to_bytes(8, "little")
    assert image.count(named) == 1
    data.write_bytes(image.replace(named, (place + (1 << 40)).to_bytes(8, "little")))
    with open_run(data) as run:
        assert run.frames.shape == (7, 5, 16)
        with pytest.raises(RunError, match=r"data\.h5: not a whole data file .*verify --rebuild") as refused:
            run.volts()
    assert "\n" not in str(refused.value)
