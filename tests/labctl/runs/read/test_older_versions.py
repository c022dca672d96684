"""Runs that were written before a column of `/shots` came: read as they are, -1 where they say nothing."""

import hashlib
import json
from pathlib import Path

import h5py
import pytest

from labctl.errors import RunError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.plan import encode_plan, read_plan
from labctl.runs.read.run import open_run

LATER = ("next_dataset_index", "next_label")


def make_older(run: Path, without: tuple[str, ...]) -> None:
    """Take columns out of the plan and of data.h5, and say that it is of version 1.0."""
    paths = RunPaths(run)
    manifest = json.loads(paths.manifest.read_text())
    planned, drive = read_plan(paths, manifest["plan_sha256"])
    kept = [name for name in planned.dtype.names or () if name not in without]
    image = encode_plan(planned[kept].astype([(name, planned.dtype[name]) for name in kept]), drive)
    paths.plan.write_bytes(image)
    manifest |= {"format_version": "1.0", "plan_sha256": hashlib.sha256(image).hexdigest()}
    paths.manifest.write_text(json.dumps(manifest))
    with h5py.File(paths.data, "r+") as file:
        shots = file["shots"][:]
        del file["shots"]
        file["shots"] = shots[kept].astype([(name, shots.dtype[name]) for name in kept])
        file.attrs["format_version"] = "1.0"


def test_both_ways_of_reading_fill_in_what_came_later(whole: Path) -> None:
    make_older(whole, LATER)
    with open_run(whole / "data.h5") as data, open_run(whole) as run:
        for one in (data, run):
            assert one.shots["kind"][2] == "image"
            assert set(one.shots["next_label"]) == set(one.planned["next_dataset_index"]) == {-1}
    (whole / "data.h5").unlink()
    with open_run(whole) as shards:
        assert set(shards.shots["next_label"]) == {-1}
        assert shards.frames.shape == (7, 5, 16)


def test_what_every_version_has_must_be_there(whole: Path) -> None:
    make_older(whole, ("label",))
    with open_run(whole / "data.h5") as data, pytest.raises(RunError, match="without label"):
        _ = data.shots
    (whole / "data.h5").unlink()
    with pytest.raises(RunError, match=r"plan\.h5: its shots are not planned ones \(without label\)"):
        open_run(whole)
