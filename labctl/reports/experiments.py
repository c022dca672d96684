"""The report of the paper's experiments: one table of all, a section for each, and where it all came from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from labctl.reports.figures import save_figure
from labctl.reports.page import (
    Bullets,
    Folded,
    Paragraph,
    Part,
    Picture,
    Result,
    Results,
    Section,
    mapping_section,
    mapping_table,
    write_report,
)

LARGEST_SVG = 600_000
"""Figures whose SVG has more bytes than this go into the report as PNG."""
SHORT = 20
"""Table cells of at most so many characters are not broken into lines."""


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
        results: The comparison with the paper; the rows with a verdict stand in the table of all experiments.
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
        return all(result.reached is not False for result in self.results)


@dataclass(frozen=True)
class Overview:
    """The table of all experiments: a line for each figure that must be reached, or one line where none must."""

    entries: Sequence[ExperimentEntry]

    def html(self) -> str:
        """The part as HTML."""
        compared = ("paper", "here (mean ± sd)", "must reach", "baseline")
        names = ("experiment", "", *compared, "seeds &times; splits", "verdict", "seconds")
        head = "".join(f'<th scope="col">{name}</th>' for name in names)
        body = "".join(_overview_rows(entry) for entry in self.entries)
        return f'<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>'


def _overview_rows(entry: ExperimentEntry) -> str:
    judged = [result for result in entry.results if result.reached is not None] or list(entry.results[:1])
    verdicts = {True: ("pass", "good"), False: ("short", "bad"), None: ("", "none")}
    rows: list[str] = []
    for result in judged:
        first = not rows
        word, verdict = verdicts[result.reached]
        name = f'<a href="#{escape(entry.name)}">{escape(entry.name)}</a>' if first else ""
        cells = [escape(text) for text in (result.name, result.paper, result.here, result.required, result.baseline)]
        repeats = f"{len(entry.seeds)}" + (f" &times; {entry.splits}" if entry.splits else "") if first else ""
        seconds = f"{entry.seconds:.0f}" if first else ""
        looks = ["short" if len(cell) <= SHORT else "long" for cell in cells]
        rows.append(
            f'<tr><th scope="row">{name}</th>'
            + "".join(f'<td class="{look}">{cell}</td>' for look, cell in zip(looks, cells, strict=True))
            + f'<td class="short">{repeats}</td><td class="{verdict}">{word}</td><td>{seconds}</td></tr>\n'
        )
    return "".join(rows)


def experiments_report(
    path: Path,
    *,
    entries: Sequence[ExperimentEntry],
    provenance: Mapping[str, Any],
    title: str = "The paper's experiments on this bench",
) -> Path:
    """Write the report and, in `figures/` beside it, each figure as PNG and SVG; returns the path of the report.

    Args:
        path: The HTML file; an existing one is replaced. Its directory is made.
        entries: The experiments, in the order of the report; the first result of each is its headline.
        provenance: Versions, revision, settings common to all; may be nested.
        title: Headline.
    """
    directory = path.parent / "figures"
    directory.mkdir(parents=True, exist_ok=True)
    passed, seconds = sum(entry.passed for entry in entries), sum(entry.seconds for entry in entries)
    summary = (
        f"{passed} of {len(entries)} experiments reach what they must; all took {seconds:.0f} s. "
        "Values are mean ± standard deviation over seeds and splits."
    )
    write_report(
        path,
        title=title,
        sections=(
            Section("All experiments", (Paragraph(summary), Overview(entries))),
            *(_experiment_section(entry, directory) for entry in entries),
            mapping_section("Where it came from", provenance),
        ),
    )
    return path


def _experiment_section(entry: ExperimentEntry, directory: Path) -> Section:
    parts: list[Part] = [Paragraph(entry.statement), Results(entry.results)]
    if entry.cause:
        parts.append(Paragraph(f"Why it falls short: {entry.cause}"))
    for drawn in entry.figures:
        png, svg = save_figure(drawn.figure, directory / f"{entry.name}-{drawn.stem}")
        chosen = svg if svg.stat().st_size <= LARGEST_SVG else png
        parts.append(Picture(chosen, f"{entry.title}: {drawn.stem}", drawn.caption))
    if entry.notes:
        parts.append(Bullets(entry.notes))
    trained = f"; {entry.splits} random splits for each" if entry.splits else ""
    seeds = ", ".join(str(seed) for seed in entry.seeds)
    parts.append(Paragraph(f"Seeds {seeds}{trained}; {entry.seconds:.0f} s." if seeds else f"{entry.seconds:.0f} s."))
    if entry.settings:
        parts.append(Folded("Settings", (mapping_table(entry.settings),)))
    return Section(f"{entry.name}: {entry.title}", parts, anchor=entry.name)
