"""A column that is added as the page says is in files, readers and exports, and older runs are read as before."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.checkout import ROOT
from tests.docs.test_blocks import BLOCK

PACKAGES = ("labctl", "protocols", "instruments", "sim_backends", "data")
DECLARED = ')\n"""The columns of `/shots`."""\n'
FIELD = "    next_label: int = -1\n"
USED = """
import math, sys
from dataclasses import replace
from pathlib import Path

import h5py, numpy as np

import labctl
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from labctl.runs.export import Content, write
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from protocols.image_readout import ImageReadout


class Exposed(ImageReadout):
    def shots(self, inputs):
        return [replace(shot, exposure_s=1e-3 * shot.index) for shot in super().shots(inputs)]


older, folder = map(Path, sys.argv[1:])
acquire(Acquisition(Exposed(images=8, ports=(2,)), SIMULATED_STATION, folder / "run"))
with open_run(folder / "run") as run, labctl.open_run(folder / "run") as dataset:
    expected = 1e-3 * run.shots["index"]
    assert np.array_equal(run.shots["exposure_s"], expected)
    assert np.array_equal(dataset.exposure_s, expected) and dataset.exposure_s.units == "s"
    write(Content.of(run, None, "codes"), "npz", folder / "run.npz")
with np.load(folder / "run.npz") as exported, h5py.File(folder / "run" / "data.h5") as file:
    assert np.array_equal(exported["exposure_s"], expected)
    assert file["shots"].attrs["exposure_s"] == b"how long the picture was shown"
(folder / "run" / "data.h5").unlink()
with open_run(folder / "run") as run:
    assert np.array_equal(run.shots["exposure_s"], expected)
assert verify_run(folder / "run", rebuild=True).data_file == "current"
with open_run(older) as run:
    assert np.isnan(run.shots["exposure_s"]).all() and verify_run(older).data_file == "current"
"""


def test_the_page_is_enough(tmp_path: Path) -> None:
    column, field = (block for name, block in BLOCK.findall(page()) if name == "{code-block}")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    insert(tmp_path / "labctl" / "runs" / "format" / "columns.py", DECLARED, column)
    insert(tmp_path / "protocols" / "base.py", FIELD, field, behind=True)
    version = tmp_path / "labctl" / "runs" / "format" / "version.py"
    version.write_text(version.read_text("utf-8").replace('FORMAT_VERSION = "1.4"', 'FORMAT_VERSION = "1.5"'), "utf-8")
    older = ROOT / "tests" / "labctl" / "runs" / "older" / "1.1" / "complete"
    used = subprocess.run(
        [sys.executable, "-c", USED, str(older), str(tmp_path)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        check=False,
        capture_output=True,
        text=True,
    )
    assert used.returncode == 0, used.stderr


def page() -> str:
    return (ROOT / "docs" / "how-to" / "add-a-column.md").read_text("utf-8")


def insert(path: Path, at: str, block: str, *, behind: bool = False) -> None:
    """Put a block of the page before or behind the one place in a file that reads so, and import what it needs."""
    text = path.read_text("utf-8")
    assert text.count(at) == 1
    text = text.replace(at, at + block if behind else block + at)
    path.write_text(text.replace("from collections.abc", "import math\nfrom collections.abc", 1), "utf-8")
