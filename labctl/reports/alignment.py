"""The report of an alignment: what was found, step by step, with a picture of each."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path

from matplotlib.figure import Figure

from labctl.reports.page import embedded, write_report
from labctl.runs.format.origin import Origin

TITLES = {
    "dark": "Dark level and noise",
    "range": "Vertical range",
    "contrast": "Contrast between images",
    "repeatability": "Repeatability of one image",
    "delay": "Trigger to light",
    "depth": "Drive depth",
    "decorrelation": "Speckle against wavelength",
}


def alignment_report(
    directory: Path,
    name: str,
    started: datetime,
    *,
    findings: Sequence[tuple[str, str, str, str]],
    figures: Mapping[str, Figure],
    origin: Origin,
) -> Path:
    """Write `figures/` and `report.html` of an alignment into `directory`; returns the path of the report.

    Args:
        directory: The alignment's folder.
        name: Name of the bench.
        started: When it began, UTC.
        findings: In words: what was measured, what was found, what is good, and whether it is or what to do.
        figures: Of the steps that have one.
        origin: Of what was measured.
    """
    folder, report = directory / "figures", directory / "report.html"
    played = ", of a recording" if origin is Origin.REPLAYED else ""
    write_report(
        report,
        "alignment.html",
        title=f"Alignment of {name}, {started:%Y-%m-%d %H:%M} UTC{played}",
        titles=TITLES,
        findings=findings,
        pictures={step: embedded(figure, folder / step, origin) for step, figure in figures.items()},
    )
    return report
