"""What holds for every figure, and what one shows."""

import re
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from labctl.reports.figure_files import save_figure
from labctl.runs.format.origin import Origin


def noise(*shape: int) -> Any:
    """The same random numbers of 0..1 every time."""
    return np.random.default_rng(1).random(shape)


def check_files(draw: Callable[[], Figure], folder: Path) -> None:
    """Small files, the same bytes every time, and matplotlib's own settings left alone."""
    before = dict(mpl.rcParams)
    first, second = (astuple(save_figure(draw(), folder / stem, Origin.SIMULATED)) for stem in ("first", "second"))
    assert [path.name for path in first] == ["first.png", "first.svg", "first.pdf"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
        assert one.stat().st_size < 400_000
    assert dict(mpl.rcParams) == before
    assert first[0].read_bytes().startswith(b"\x89PNG")
    svg = first[1].read_text(encoding="utf-8")
    root = ElementTree.fromstring(svg)  # noqa: S314  # written a moment ago, here
    assert root.tag.endswith("svg")
    assert not re.search(r"20\d\d-\d\d-\d\d", svg)
    assert "simulated bench" in svg
    check_pdf(first[2])


def check_pdf(path: Path) -> None:
    """One page as wide as one column of a journal or both, its fonts inside, no date."""
    pdf = path.read_bytes()
    assert pdf.startswith(b"%PDF")
    found = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", pdf)
    assert found
    width_mm, height_mm = (float(number) * 25.4 / 72 for number in found.groups())
    assert round(width_mm, 1) in (86, 178)
    assert height_mm < 250
    assert pdf.count(b"/FontFile2") == pdf.count(b"/Type /FontDescriptor") > 0
    assert b"CreationDate" not in pdf


def check_figure(draw: Callable[[], Figure], folder: Path) -> None:
    """As `check_files`, and where there are curves the axes are named, with a unit."""
    check_files(draw, folder)
    figure = draw()
    figure.draw_without_rendering()
    shown = [axes for axes in figure.axes if axes.get_visible() and axes.lines]
    for axes in shown:
        named = re.search(r"\(.+\)|number of|step|parameter|levels|RMSE", axes.get_xlabel())
        assert named or not axes.get_xlabel(), axes.get_xlabel()
    if shown:
        assert any(axes.get_xlabel() for axes in shown)
        assert any(axes.get_ylabel() for axes in shown) or figure.get_supylabel()


def legend(figure: Figure) -> list[str]:
    """Names in the legends of the panels and of the figure."""
    found = [axes.get_legend() for axes in figure.axes] + list(figure.legends)
    return [text.get_text() for one in found if one is not None for text in one.get_texts()]


def beside(axes: Axes) -> list[str]:
    """What is written in and beside a panel."""
    return [text.get_text() for text in axes.texts]


def visible_words(figure: Figure) -> list[str]:
    """All texts of a figure."""
    return [text.get_text() for text in figure.findobj(Text) if isinstance(text, Text)]
