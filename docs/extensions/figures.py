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
    with _begun("align", "--out", made / "calibration") as alignment:
        for words in (
            ("run", *RUN, "--out", run),
            ("show", run),
            ("train", run, "--window", "1 ns", "--ports", "2-6", "--out", readout),
            ("evaluate", readout, run),
        ):
            with _begun(*words) as command:
                _succeeded(command)
        _succeeded(alignment)


def _begun(*words: str | Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "labctl", *words], stdout=subprocess.DEVNULL)


def _succeeded(command: subprocess.Popen[bytes]) -> None:
    if status := command.wait():
        raise subprocess.CalledProcessError(status, command.args)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
