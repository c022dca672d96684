import io
import re
import zlib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fontTools import subset
from fontTools.ttLib import TTFont
from matplotlib.figure import Figure
from PIL import Image

from labctl.reports.canvas import Series
from labctl.reports.figure_files import save_figure
from labctl.reports.figures.traces import traces_figure
from labctl.reports.figures.window import accuracy_figure
from labctl.reports.pictures import join_pictures, png_of
from labctl.runs.format.origin import Origin

WINDOWS_S = [0.08e-9, 0.16e-9, 0.24e-9, 0.32e-9, 0.4e-9, 0.48e-9, 0.56e-9, 0.8e-9, 1e-9, 1.5e-9, 2e-9]


def curves(*labels: str) -> Figure:
    accuracies = np.linspace(0.5, 0.95, len(WINDOWS_S)).tolist()
    series = [Series(label, WINDOWS_S, accuracies, [0.02] * len(WINDOWS_S)) for label in labels]
    return accuracy_figure(series, tau_s=40e-12, chance=0.25)


def panels() -> Figure:
    time_s = np.arange(50) * 40e-12
    return traces_figure(time_s, np.ones((2, 3, 50)), shots=["a", "b"], ports=["port 2", "port 3", "port 4"])


def fonts_in(pdf: Path) -> list[TTFont]:
    """The TrueType fonts inside, which begin with their version, 1.0."""
    packed = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf.read_bytes(), re.DOTALL)
    streams = [zlib.decompress(stream) for stream in packed if stream[:1] == b"\x78"]
    return [TTFont(io.BytesIO(stream)) for stream in streams if stream.startswith(b"\0\1\0\0")]


def width_mm(pdf: Path) -> float:
    (width,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ", pdf.read_bytes())
    return round(float(width) * 25.4 / 72, 1)


def test_one_panel_is_as_wide_as_a_column_and_several_as_two(tmp_path: Path) -> None:
    assert width_mm(save_figure(curves("chip", "chip bypassed"), tmp_path / "one", Origin.REAL).pdf) == 86
    assert width_mm(save_figure(panels(), tmp_path / "several", Origin.REAL).pdf) == 178


def test_what_would_be_cut_off_in_a_column_is_given_two(tmp_path: Path) -> None:
    names = [f"with the chip {number}" for number in range(6)]
    assert width_mm(save_figure(curves(*names), tmp_path / "many", Origin.REAL).pdf) == 178


def test_a_pdf_holds_the_glyphs_of_its_fonts_and_nothing_that_chooses_them(tmp_path: Path) -> None:
    load = subset.load_font
    fonts = fonts_in(save_figure(curves("chip"), tmp_path / "curves", Origin.REAL).pdf)
    assert fonts
    for font in fonts:
        assert len(font.getGlyphOrder()) < 100
        assert "glyf" in font
        assert not {"GDEF", "GPOS", "GSUB"} & set(font.keys())
    assert subset.load_font is load


def test_no_number_at_an_axis_touches_another(tmp_path: Path) -> None:
    figure = curves("chip")
    save_figure(figure, tmp_path / "curves", Origin.REAL)
    figure.draw_without_rendering()
    labels = [label for label in figure.axes[0].get_xticklabels() if label.get_visible()]
    ends = [label.get_window_extent() for label in labels]
    assert 4 < len(labels) < len(WINDOWS_S)
    assert all(one.x1 < other.x0 for one, other in pairwise(ends))


@pytest.mark.parametrize(
    ("origin", "words"),
    [(Origin.SIMULATED, ">simulated bench<"), (Origin.MIXED, ">partly simulated bench<")],
)
def test_a_figure_says_that_it_is_simulated_and_nothing_lies_on_that(
    origin: Origin, words: str, tmp_path: Path
) -> None:
    figure = panels()
    pictures = save_figure(figure, tmp_path / "marked", origin)
    assert words in pictures.svg.read_text("utf-8")
    (mark,) = [text for text in figure.texts if "simulated" in text.get_text()]
    figure.draw_without_rendering()
    boxes = [box for axes in figure.axes if (box := axes.get_tightbbox()) is not None]
    assert max(box.y1 for box in boxes) < mark.get_window_extent().y0


def test_a_figure_of_a_bench_says_nothing(tmp_path: Path) -> None:
    assert "simulated" not in save_figure(panels(), tmp_path / "bench", Origin.REAL).svg.read_text("utf-8")


@pytest.mark.parametrize("origin", Origin)
def test_a_picture_for_the_moment_is_that_of_the_file(origin: Origin, tmp_path: Path) -> None:
    assert png_of(panels(), origin) == save_figure(panels(), tmp_path / "figure", origin).png.read_bytes()


def test_pictures_are_joined_below_each_other(tmp_path: Path) -> None:
    parts = [tmp_path / "wide.png", tmp_path / "high.png"]
    for part, size in zip(parts, ((4, 1), (2, 3)), strict=True):
        Image.new("RGB", size, "black").save(part)
    join_pictures(parts, tmp_path / "all.png")
    with Image.open(tmp_path / "all.png") as joined:
        assert joined.size == (4, 4)
        assert joined.getpixel((3, 3)) == (255, 255, 255)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all.png", "high.png", "wide.png"]
