"""The report of a wavelength scan: correlation against detuning, half width, where it came from."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from labctl.analysis.decorrelation import Decorrelation, Scan, delay_spread_s, expected_correlation, frequency_hz
from labctl.reports.figures.decorrelation import decorrelation_figure, open_decorrelation_figure
from labctl.reports.page import embedded, write_report
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin

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
    points = zip(found.detuning_nm, found.correlation, strict=True)
    write_report(
        paths.report,
        "decorrelation.html",
        title=f"Wavelength scan: {directory.name}",
        lines=lines,
        correlation=embedded(_figure(scan, found), paths.figures / "correlation", Origin.of(manifest)),
        caption=(
            "Correlation of the intensity of traces at two wavelengths, mean of all pairs so far apart and of all "
            "images; each trace about its own mean, the receiver's noise taken off."
        ),
        rows=[(f"{1e3 * detuning:.3g}", f"{value:.3f}") for detuning, value in points],
        manifest=manifest,
    )
    return paths.report


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
    bound_nm = PAPER_NM if found.detuning_nm[-1] > 2 * PAPER_NM else None  # else its line would be in the legend's way
    return decorrelation_figure(found.detuning_nm, curves, half_width_nm=found.half_width_nm, bound_nm=bound_nm)
