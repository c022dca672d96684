"""`labctl export` as it is typed: which file, which shots, and what is refused."""

from pathlib import Path

import numpy as np

from labctl.runs.read.run import open_run
from tests.labctl.commands.conftest import AsJson, Typed


def test_the_command(bench_run: Path, tmp_path: Path, as_json: AsJson, typed: Typed) -> None:
    status, found = as_json(
        "export", bench_run, "--to", "npz", "--out", tmp_path / "few.npz", "--shots", "2-4", "--codes"
    )
    assert (status, found["shots"], found["traces"]) == (0, 3, "codes")
    assert found["bytes"] == (tmp_path / "few.npz").stat().st_size
    with np.load(tmp_path / "few.npz") as few, open_run(bench_run) as run:
        np.testing.assert_array_equal(few["frames"], run.frames[2:5])
    before = (tmp_path / "few.npz").read_bytes()
    for words, message in (
        (("--to", "npz", "--out", tmp_path / "few.npz"), "few.npz: exists: name another file"),
        (("--to", "excel"), "--to excel: choose one of netcdf, zarr, npz, csv"),
        (
            ("--to", "csv", "--shots", "99", "--out", tmp_path / "x.csv"),
            "there is nothing to export: it has shots 0 to",
        ),
        (("--to", "csv", "--out", tmp_path / "no" / "x.csv"), "x.csv: cannot be written"),
    ):
        status, out, told = typed("export", bench_run, *words)
        assert (status, out, told.count("\n")) == (2, "", 1)
        assert message in told
    assert (tmp_path / "few.npz").read_bytes() == before
    status, told, _ = typed("export", bench_run / "data.h5", "--to", "csv", "--shots", "0")
    assert status == 0
    assert told.startswith(f"{bench_run}.csv: 1 shots")
    Path(f"{bench_run}.csv").unlink()
