"""Draws the pictures of the documents with labctl itself, on the simulated bench, whenever the documents are built."""

import shutil
import subprocess
import sys
from pathlib import Path

from sphinx.application import Sphinx

RUN = ("image-readout", "--set", "images=200", "--set", "seed=7", "--set", "window=2 ns")


def draw(app: Sphinx) -> None:
    """Acquire one small run, train a readout, evaluate it; keep run and figures under `made/`."""
    made = Path(app.srcdir) / "made"
    run = made / "run"
    if (run / "report.html").exists():
        return
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir()
    _labctl("run", *RUN, "--out", str(run))
    _labctl("train", str(run), "--window", "1 ns", "--ports", "2-6", "--out", str(made / "readout.h5"))
    _labctl("evaluate", str(made / "readout.h5"), str(run))
    for figure in (run / "figures").glob("*.png"):
        shutil.copy(figure, made / figure.name)


def _labctl(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "labctl", *words], check=True, stdout=subprocess.DEVNULL)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
