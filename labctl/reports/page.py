"""A report as one self-contained HTML file: figures inside, no links to anything, no script.

What a report looks like is in `templates/`: a file for each report, in the frame of `base.html`. All text is escaped
there.
"""

import base64
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from labctl.analysis.intervals import Verdict
from labctl.errors import writing
from labctl.reports.figure_files import save_figure
from labctl.runs.format.durable import not_made, replace_file
from labctl.runs.format.origin import Origin

Name = TypeVar("Name")
CarryOut = Callable[[Mapping[Name, Callable[[], str]]], Mapping[Name, str]]
"""Who lets figures be `embedded`, one after the other or side by side: what each returns, under its name."""

LARGEST_SVG = 600_000
"""Figures whose SVG has more bytes than this go into a report as PNG."""


@dataclass(frozen=True)
class Averaged:
    """The same as a `Result`, with the mean of several triggers in place of single ones; fields as there."""

    required: str
    here: str
    verdict: Verdict | None


@dataclass(frozen=True)
class Result:
    """One line of the comparison with the paper.

    Attributes:
        name: What was measured.
        paper: What the paper reports.
        required: What must be reached here; empty = nothing is required.
        here: What was reached.
        verdict: Whether `here` meets `required`; None = nothing is required.
        baseline: What others reach on the same data; empty = nothing to compare with.
        averaged: What the mean of several triggers reaches; None = nothing was averaged.
        repeats: On how many seeds and splits.
    """

    name: str
    paper: str
    required: str
    here: str
    verdict: Verdict | None
    baseline: str = ""
    averaged: Averaged | None = None
    repeats: str = ""


def embedded(figure: Figure, stem: Path, origin: Origin) -> str:
    """Save a figure as PNG, SVG and PDF, and return one of the first two as the source of an image in a page.

    Args:
        figure: The figure.
        stem: Path of its files, without suffix.
        origin: Of the records that it shows.

    Raises:
        NotWritten: They cannot be written; names their folder, which is made.
    """
    with writing(stem.parent):
        stem.parent.mkdir(parents=True, exist_ok=True)
        pictures = save_figure(figure, stem, origin)
    kind, path = "svg+xml", pictures.svg
    if path.stat().st_size > LARGEST_SVG:
        kind, path = "png", pictures.png
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """A row, name and text, for each value of a nested mapping such as settings or a manifest."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{name}.")
        elif isinstance(value, list | tuple) and any(isinstance(entry, Mapping) for entry in value):
            yield from flat({str(position): entry for position, entry in enumerate(value)}, f"{prefix}{name}.")
        elif isinstance(value, list | tuple):
            yield f"{prefix}{name}", ", ".join(str(entry) for entry in value)
        else:
            yield f"{prefix}{name}", str(value)


TEMPLATES = Environment(
    loader=PackageLoader("labctl.reports"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
TEMPLATES.filters["flat"] = flat


def write_report(path: Path, template: str, **content: Any) -> None:
    """Write a report; the file appears complete or not at all, with the same bytes for the same content.

    Args:
        path: File to write, for instance `report.html`; an existing one is replaced.
        template: File in `templates/` that says what is shown, and how.
        content: What it shows, by the names in the template; `title` always.

    Raises:
        RunError: The file cannot be written.
    """
    text = TEMPLATES.get_template(template).render(content)
    replace_file(path, text.encode(errors="backslashreplace"), not_made)
