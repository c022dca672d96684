import base64
from pathlib import Path

import numpy as np
import pytest
from jinja2 import UndefinedError
from matplotlib.figure import Figure

from labctl.reports import page
from labctl.reports.figures.images import images_figure
from labctl.reports.page import embedded, flat, write_report
from labctl.runs.format.origin import Origin
from tests.labctl.reports.html import Page


def figure() -> Figure:
    return images_figure(np.eye(28)[np.newaxis], ["one"])


def test_a_figure_is_embedded_as_the_text_of_its_svg(tmp_path: Path) -> None:
    source = embedded(figure(), tmp_path / "figure", Origin.REAL)
    assert source.startswith("data:image/svg+xml;base64,")
    assert base64.b64decode(source.split(",", 1)[1]) == (tmp_path / "figure.svg").read_bytes()
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_a_large_figure_is_embedded_as_png(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "LARGEST_SVG", 10)
    assert embedded(figure(), tmp_path / "figure", Origin.REAL).startswith("data:image/png;base64,")


def test_nested_values_become_rows() -> None:
    manifest = {
        "protocol": {"name": "image-readout", "ports": [2, 3]},
        "instruments": [{"kind": "awg", "identity": "<b>TEKTRONIX</b>"}],
        "seed": 1,
    }
    assert list(flat(manifest)) == [
        ("protocol.name", "image-readout"),
        ("protocol.ports", "2, 3"),
        ("instruments.0.kind", "awg"),
        ("instruments.0.identity", "<b>TEKTRONIX</b>"),
        ("seed", "1"),
    ]


def test_a_report_appears_complete_or_not_at_all(tmp_path: Path) -> None:
    with pytest.raises(UndefinedError):
        write_report(tmp_path / "report.html", "base.html")
    assert not list(tmp_path.iterdir())
    write_report(tmp_path / "report.html", "base.html", title="A <run>")
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert Page(tmp_path / "report.html").words.count("A <run>") == 2
