"""A report as one HTML file that stands alone: figures inside, no links to anything, no script.

A report is a list of sections, a section a list of parts (text, tables, figures). All text is escaped here.
"""

import base64
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Protocol


class Part(Protocol):
    """What can stand in a section."""

    def html(self) -> str:
        """The part as HTML, all text escaped."""
        ...


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text."""

    text: str

    def html(self) -> str:
        """The part as HTML."""
        return f"<p>{escape(self.text)}</p>"


@dataclass(frozen=True)
class Bullets:
    """A list of short remarks."""

    items: Sequence[str]

    def html(self) -> str:
        """The part as HTML."""
        return "<ul>\n" + "".join(f"<li>{escape(item)}</li>\n" for item in self.items) + "</ul>"


@dataclass(frozen=True)
class Folded:
    """Parts that stay folded away until the reader opens them, such as long settings."""

    summary: str
    parts: Sequence[Part]

    def html(self) -> str:
        """The part as HTML."""
        inside = "\n".join(part.html() for part in self.parts)
        return f"<details><summary>{escape(self.summary)}</summary>\n{inside}\n</details>"


@dataclass(frozen=True)
class Table:
    """A table of text; the first column holds the row's name."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def html(self) -> str:
        """The part as HTML."""
        head = "".join(f'<th scope="col">{escape(name)}</th>' for name in self.header)
        body = "".join(
            f'<tr><th scope="row">{escape(first)}</th>'
            + "".join(f"<td>{escape(cell)}</td>" for cell in rest)
            + "</tr>\n"
            for first, *rest in self.rows
        )
        return f'<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>'


@dataclass(frozen=True)
class Result:
    """One line of the comparison with the paper.

    Attributes:
        name: What was measured.
        paper: What the paper reports.
        required: What must be reached here; empty = nothing is required.
        here: What was reached.
        reached: Whether `here` meets `required`; None = nothing is required.
        baseline: What others reach on the same data; empty = nothing to compare with.
    """

    name: str
    paper: str
    required: str
    here: str
    reached: bool | None
    baseline: str = ""


@dataclass(frozen=True)
class Results:
    """The table of results, paper against here."""

    results: Sequence[Result]

    def html(self) -> str:
        """The part as HTML."""
        verdicts = {True: ("reached", "good"), False: ("falls short", "bad"), None: ("", "none")}
        compared = any(result.baseline for result in self.results)
        body = "".join(
            f'<tr><th scope="row">{escape(result.name)}</th><td>{escape(result.paper)}</td>'
            f"<td>{escape(result.required)}</td><td>{escape(result.here)}</td>"
            + (f"<td>{escape(result.baseline)}</td>" if compared else "")
            + f'<td class="{verdicts[result.reached][1]}">{verdicts[result.reached][0]}</td></tr>\n'
            for result in self.results
        )
        names = ("", "paper", "required", "here", *(("baseline",) if compared else ()), "verdict")
        head = "".join(f'<th scope="col">{name}</th>' for name in names)
        return f'<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>'


@dataclass(frozen=True)
class Picture:
    """A figure file (SVG or PNG) with a text for those who cannot see it and a caption."""

    path: Path
    alternative: str
    caption: str

    def html(self) -> str:
        """The part as HTML, the file's content inside."""
        kind = "svg+xml" if self.path.suffix == ".svg" else "png"
        content = base64.b64encode(self.path.read_bytes()).decode("ascii")
        return (
            f'<figure><img alt="{escape(self.alternative)}" src="data:image/{kind};base64,{content}">'
            f"<figcaption>{escape(self.caption)}</figcaption></figure>"
        )


@dataclass(frozen=True)
class Section:
    """A heading and what stands below it; `anchor` is a name that links on the same page can lead to."""

    title: str
    parts: Sequence[Part]
    anchor: str = ""


def mapping_section(title: str, values: Mapping[str, Any]) -> Section:
    """A section with one row for each value of a nested mapping, such as settings or a manifest (provenance)."""
    return Section(title, [mapping_table(values)])


def mapping_table(values: Mapping[str, Any]) -> Table:
    """A table with one row for each value of a nested mapping."""
    return Table(("name", "value"), [*_flat(values)])


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        elif isinstance(value, list | tuple) and any(isinstance(entry, Mapping) for entry in value):
            yield from _flat({str(position): entry for position, entry in enumerate(value)}, f"{prefix}{name}.")
        elif isinstance(value, list | tuple):
            yield f"{prefix}{name}", ", ".join(str(entry) for entry in value)
        else:
            yield f"{prefix}{name}", str(value)


def write_report(path: Path, *, title: str, sections: Sequence[Section]) -> None:
    """Write a report; the file appears complete or not at all, with the same bytes for the same content.

    Args:
        path: File to write, for instance `report.html`; an existing one is replaced.
        title: Title of the page.
        sections: What it says, in order.
    """
    body = "\n".join(
        (f'<section id="{escape(section.anchor)}">' if section.anchor else "<section>")
        + f"\n<h2>{escape(section.title)}</h2>\n"
        + "\n".join(part.html() for part in section.parts)
        + "\n</section>"
        for section in sections
    )
    partial = path.with_name(path.name + ".partial")
    partial.write_text(PAGE.format(title=escape(title), style=STYLE, body=body), encoding="utf-8", newline="\n")
    os.replace(partial, path)


STYLE = """
:root { color-scheme: light; }
body { margin: 2rem auto; max-width: 68rem; padding: 0 1rem; background: #fff; color: #1a1a1a;
       font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.7rem; border-bottom: 2px solid #0072b2; padding-bottom: .3rem; }
h2 { font-size: 1.2rem; margin-top: 2rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; text-align: left; vertical-align: top; border-bottom: 1px solid #d9d9d9; }
thead th { border-bottom: 2px solid #8c8c8c; }
tbody th { font-weight: normal; }
td { overflow-wrap: anywhere; }
.short { white-space: nowrap; }
.good { color: #00664a; font-weight: bold; }
.bad { color: #a64500; font-weight: bold; }
summary { cursor: pointer; color: #005a8c; }
figure { margin: 1.5rem 0; }
img { max-width: 100%; height: auto; }
figcaption { color: #595959; font-size: .9rem; }
"""

PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<h1>{title}</h1>
{body}
</body>
</html>
"""
