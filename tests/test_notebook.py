"""The notebooks of the documents run from their first cell to their last, and are kept without their results."""

from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from tests.checkout import ROOT

FOLDER = ROOT / "docs" / "how-to"
SHOWN = {"look-at-a-run": "unseen images", "from-a-notebook": "shots kept apart"}
notebooks = pytest.mark.parametrize("name", SHOWN)


def as_kept(name: str) -> Any:
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)  # type: ignore[no-untyped-call]


@notebooks
def test_the_notebook_does_what_it_says(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    notebook = as_kept(name)
    NotebookClient(notebook, timeout=200, resources={"metadata": {"path": str(tmp_path)}}).execute()
    told = "".join(str(cell.get("outputs", "")) for cell in notebook.cells)
    assert "image/png" in told
    assert SHOWN[name] in told
    assert "Warning" not in told


@notebooks
def test_it_is_kept_without_results(name: str) -> None:
    notebook = as_kept(name)
    nbformat.validate(notebook)
    assert all(not cell.get("outputs") and not cell.get("execution_count") for cell in notebook.cells)
