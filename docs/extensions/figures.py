"""Draws the pictures of the documents with labctl itself, on the simulated bench, whenever the documents are built.

`made/` then holds a small run, `runs/mine`, which the examples open, and an alignment, `calibration`.
"""

import shutil
import subprocess
import sys
from pathlib import Path

from sphinx.application import Sphinx

RUN = ("image-readout", "--set", "images=200", "--set", "seed=7", "--set", "window=2 ns")


def draw(app: Sphinx) -> None:
    """Acquire one small run, look at it, train and evaluate a readout; align the bench meanwhile. Anew for HTML."""
    made = Path(app.srcdir) / "made"
    if made.exists() and app.builder.name != "html":
        return
    shutil.rmtree(made, ignore_errors=True)
    run, readout = made / "runs" / "mine", made / "readout.h5"
    with subprocess.Popen(_command("align", "--out", made / "calibration"), stdout=subprocess.DEVNULL) as alignment:
        _labctl("run", *RUN, "--out", run)
        _labctl("show", run)
        _labctl("train", run, "--window", "1 ns", "--ports", "2-6", "--out", readout)
        _labctl("evaluate", readout, run)
    if alignment.returncode:
        raise subprocess.CalledProcessError(alignment.returncode, alignment.args)


def _labctl(*words: str | Path) -> None:
    subprocess.run(_command(*words), check=True, stdout=subprocess.DEVNULL)


def _command(*words: str | Path) -> list[str | Path]:
    return [sys.executable, "-m", "labctl", *words]


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
