"""The report of the paper's experiments: one table of all, a section for each, and where it all came from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from labctl.analysis.intervals import Verdict
from labctl.reports.page import CarryOut, Result, embedded, write_report
from labctl.runs.format.origin import Origin


@dataclass(frozen=True)
class ExperimentFigure:
    """A figure of an experiment.

    Attributes:
        stem: Name of its files, without the experiment's name and without suffix.
        figure: The figure.
        caption: What it shows, one or two sentences.
    """

    stem: str
    figure: Figure
    caption: str


@dataclass(frozen=True)
class ExperimentEntry:
    """What one experiment brought out.

    Attributes:
        name: Its name on the command line, such as "fig3".
        title: A few words: what is done.
        statement: What the paper claims and what is measured here, a few sentences.
        results: The comparison with the paper.
        origin: Of the records in its figures.
        figures: Its figures.
        seeds: Seeds it was repeated over.
        splits: Random splits for each seed; 0 = nothing is trained.
        seconds: How long it took, wall time.
        settings: Everything that was set: protocol, station, readout; may be nested.
        notes: Pitfalls, and what a reader must know to judge the numbers.
        cause: Why a figure falls short; empty where none does.
    """

    name: str
    title: str
    statement: str
    results: Sequence[Result]
    origin: Origin
    figures: Sequence[ExperimentFigure] = ()
    seeds: Sequence[int] = ()
    splits: int = 0
    seconds: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
    cause: str = ""

    @property
    def passed(self) -> bool:
        """Whether nothing that was required falls short."""
        verdicts = [one.verdict for result in self.results for one in (result, result.averaged) if one is not None]
        return Verdict.NOT_REACHED not in verdicts

    @property
    def averaged(self) -> bool:
        """Whether any of its results has the mean of several triggers beside it."""
        return any(result.averaged is not None for result in self.results)


def experiments_report(
    path: Path,
    *,
    entries: Sequence[ExperimentEntry],
    provenance: Mapping[str, Any],
    title: str,
    carried_out: CarryOut[tuple[str, str]],
) -> Path:
    """Write the report and, in `figures/` beside it, each figure as PNG, SVG and PDF; returns the path of the report.

    Args:
        path: The HTML file; an existing one is replaced. Its directory is made.
        entries: The experiments, in their order on the page.
        provenance: Versions, seeds, station, times; may be nested.
        title: Headline.
        carried_out: Who lets the figures be drawn.
    """
    folder = path.parent / "figures"
    sources = carried_out(
        {
            (entry.name, drawn.stem): partial(
                embedded, drawn.figure, folder / f"{entry.name}-{drawn.stem}", entry.origin
            )
            for entry in entries
            for drawn in entry.figures
        }
    )
    write_report(path, "experiments.html", title=title, entries=entries, sources=sources, manifest=provenance)
    return path
