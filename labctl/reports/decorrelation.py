"""The report of a wavelength scan: correlation against detuning, half width, where it came from."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from labctl.analysis.decorrelation import (
    Decorrelation,
    Scan,
    delay_spread_s,
    expected_correlation,
    frequency_hz,
)
from labctl.reports.axes import Level, Series, draw_series, label_curves
from labctl.reports.curves import decorrelation_figure
from labctl.reports.figures import save_figure
from labctl.reports.page import Bullets, Paragraph, Picture, Section, Table, mapping_section, write_report
from labctl.reports.style import STYLE
from labctl.runs.format.layout import RunPaths

PAPER_NM = 0.02
"""Decorrelation that the paper estimates for its 20 m of fibre: less than this."""


def decorrelation_report(
    directory: Path, scan: Scan, found: Decorrelation, *, lines: Sequence[str], manifest: Mapping[str, Any]
) -> Path:
    """Write `figures/correlation` and `report.html` of the run in `directory` and return the path of the report.

    Args:
        directory: Run directory.
        scan: What was measured.
        found: What it says.
        lines: The result in words.
        manifest: Where it came from.
    """
    paths = RunPaths(directory)
    paths.figures.mkdir(exist_ok=True)
    _, svg = save_figure(_figure(scan, found), paths.figures / "correlation")
    caption = (
        "Correlation of the intensity of traces at two wavelengths, mean of all pairs so far apart and of all images; "
        "each trace about its own mean, the receiver's noise taken off."
    )
    write_report(
        paths.report,
        title=f"Wavelength scan: {directory.name}",
        sections=(
            Section("What came out", (Bullets(lines), Picture(svg, caption, caption))),
            Section("In numbers", (_table(found),)),
            Section(
                "What it means",
                (
                    Paragraph(
                        "The correlation of intensities is the squared modulus of the Fourier transform of the "
                        "distribution of the modes' delays (Siegert's relation; Goodman, Speckle Phenomena in Optics). "
                        "Light of two wavelengths further apart than a few half widths projects independent masks."
                    ),
                ),
            ),
            mapping_section("Where it came from", manifest),
        ),
    )
    return paths.report


def open_decorrelation_figure(detuning_nm: ArrayLike, correlation: ArrayLike, *, label: str) -> Figure:
    """Correlation (k,) against detuning (k,) in pm, of a scan that is too short or too coarse to mark a half width."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axes = figure.add_subplot()
        axes.grid(visible=True, axis="y")
        pm, values = 1e3 * np.asarray(detuning_nm, np.float64), np.asarray(correlation, np.float64)
        measured = Series(label, pm.tolist(), values.tolist(), [0.0] * pm.size)
        draw_series(axes, [measured])
        axes.set(xlabel="detuning (pm)", ylabel="correlation (1 = same)", ylim=(min(-0.05, 1.1 * values.min()), 1.05))
        label_curves(axes, [measured], [Level("one half", 0.5)])
        axes.legend(loc="upper right", handlelength=3)
    return figure


def _figure(scan: Scan, found: Decorrelation) -> Figure:
    measured = f"measured, {found.images} images"
    if found.half_width_nm is None:
        return open_decorrelation_figure(found.detuning_nm, found.correlation, label=measured)
    curves = [(measured, found.correlation)]
    half_width_hz = frequency_hz(found.half_width_nm, scan.centre_nm)
    spread_s = delay_spread_s(half_width_hz, launch="gaussian", symbol_s=scan.symbol_s)
    if spread_s is not None and not any(scan.ports):
        detuning_hz = half_width_hz / found.half_width_nm * found.detuning_nm
        expected = expected_correlation(detuning_hz, spread_s, launch="gaussian", symbol_s=scan.symbol_s)
        curves.append((f"Gaussian launch, delay spread {spread_s * 1e9:.2g} ns", expected))
    bound_nm = PAPER_NM if found.detuning_nm[-1] > 2 * PAPER_NM else None  # else it would stand in the legend
    return decorrelation_figure(found.detuning_nm, curves, half_width_nm=found.half_width_nm, bound_nm=bound_nm)


def _table(found: Decorrelation) -> Table:
    rows = [
        (f"{1e3 * detuning:.3g}", f"{value:.3f}")
        for detuning, value in zip(found.detuning_nm, found.correlation, strict=True)
    ]
    return Table(("detuning (pm)", "correlation"), rows)
