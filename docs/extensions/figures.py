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
    """Acquire one small run, look at it, train a readout, evaluate it; align the bench. The HTML is drawn anew."""
    made = Path(app.srcdir) / "made"
    if made.exists() and app.builder.name != "html":
        return
    shutil.rmtree(made, ignore_errors=True)
    run, readout = made / "runs" / "mine", made / "readout.h5"
    _labctl("run", *RUN, "--out", run)
    _labctl("show", run)
    _labctl("train", run, "--window", "1 ns", "--ports", "2-6", "--out", readout)
    _labctl("evaluate", readout, run)
    _labctl("align", "--out", made / "calibration")


def _labctl(*words: str | Path) -> None:
    subprocess.run([sys.executable, "-m", "labctl", *words], check=True, stdout=subprocess.DEVNULL)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
