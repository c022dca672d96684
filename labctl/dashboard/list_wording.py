"""What the list of runs says, as HTML: all text from runs is escaped here."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from urllib.parse import quote

from labctl.dashboard.listing import Runs, Wanted
from labctl.dashboard.sketches import escape
from labctl.runs.catalogue import Found

LONGEST_PROBLEM, LONGEST_CELL = 300, 80
HEAD = {"name": "run", "instruments": "bench", "seed": "seeds", "shots": "shots", "tag": "tags"}
LAST = {"state": "state"}
"""Keys of the columns that are always there, and what stands above them; chosen ones are between the two."""


def run_address(name: str) -> str:
    """Of the page of a run; a name that is not UTF-8 has none, and leads to the page of a run that is not there."""
    return f"run/{quoted(name)}"


def comparison_address(one: str, other: str) -> str:
    """Of the page of two runs."""
    return f"compare/{quoted(one)}/{quoted(other)}"


def quoted(name: str) -> str:
    """A run in an address: twice, since the server has unquoted it once when it looks for slashes and line breaks."""
    return quote(quote(name, safe="", errors="replace"), safe="")


def run_list(runs: Runs) -> str:
    """The runs that were searched for, or why the words are not understood."""
    if runs.refused or not runs.found:
        why = runs.refused or ("no run is of that kind" if runs.wanted.words.strip() else "no runs")
        return f'<p class="nothing">{escape(why)}</p>'
    columns = [key for key in runs.wanted.columns if key not in HEAD | LAST]
    rows = "".join(_row(one, columns) for one in runs.found)
    tracks = f"minmax(12rem, 1fr) repeat({len(HEAD) + len(columns)}, auto)"
    return (
        f'<p class="nothing count">{len(runs.found)} of {runs.total}</p>'
        f'<div class="runs" style="grid-template-columns: {tracks}">{_head(runs.wanted, columns)}{rows}</div>'
    )


def _head(wanted: Wanted, columns: Sequence[str]) -> str:
    """Names of the columns, each of which sorts by it."""
    shown = HEAD | {key: key for key in columns} | LAST
    return '<div class="head">' + "".join(_sorting(wanted, key, title) for key, title in shown.items()) + "</div>"


def _sorting(wanted: Wanted, key: str, title: str) -> str:
    chosen = ' class="chosen"' if wanted.sort == key else ""
    return f'<a{chosen} href="?{escape(replace(wanted, sort=key).address)}">{escape(title)}</a>'


def _row(one: Found, columns: Iterable[str]) -> str:
    row, bench = one.row, one.row.instruments or ""
    star = '<b class="star">★</b> ' if any(one.facts.get("star", ())) else ""
    cells = [
        f'<span class="name">{star}{escape(row.name)}</span>',
        f'<span class="bench {bench}">{bench}</span>',
    ]
    if row.problem:
        cells.append(f'<span class="problem">{escape(row.problem[:LONGEST_PROBLEM])}</span>')
    else:
        named = (("seed", row.seed), ("twin", row.twin_seed))
        seeds = " · ".join(f"{name} {seed}" for name, seed in named if seed is not None)
        cells += [
            f'<span class="seeds">{escape(seeds)}</span>',
            f'<span class="shots">{row.shots} of {row.planned} shots</span>',
        ]
    tags = ", ".join(map(str, one.facts.get("tag", ())))
    cells.append(f'<span class="tags">{escape(_cut(tags))}</span>')
    cells += [f'<span class="chosen" data-key="{escape(key)}">{escape(_value(one, key))}</span>' for key in columns]
    cells.append(f'<span class="state {row.state}">{row.state}</span>')
    return f'<a class="run {bench}" href="{run_address(row.name)}">{"".join(cells)}</a>'


def _value(one: Found, key: str) -> str:
    values = one.facts.get(key, ())
    return _cut(", ".join(f"{value:.6g}" if isinstance(value, float) else value for value in values))


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST_CELL else f"{text[:LONGEST_CELL]}..."
