"""Rows of text in columns, as a table is printed for people: ten thousand of them in a blink."""

from collections.abc import Iterator, Sequence
from itertools import zip_longest

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

GAP = "  "


def in_columns(rows: Sequence[Sequence[str]], console: Console) -> Iterator[str]:
    """The rows as lines that are no longer than the console is wide, as far as that can be: the widest columns yield.

    What is too long for its column goes on below, since what is cut off, such as an address, nobody can use.
    """
    widths = _fitted([max(map(cell_len, column)) for column in zip(*rows, strict=True)], console.width)
    for row in rows:
        if all(cell_len(cell) <= width for cell, width in zip(row, widths, strict=True)):
            yield _line(row, widths)
            continue
        folded = [_folded(cell, width, console) for cell, width in zip(row, widths, strict=True)]
        for line in zip_longest(*folded, fillvalue=""):
            yield _line(line, widths)


def _fitted(widths: list[int], width: int) -> list[int]:
    room = width - len(GAP) * (len(widths) - 1)
    while sum(widths) > room and (widest := max(widths)) > 1:
        widths[widths.index(widest)] -= 1
    return widths


def _folded(cell: str, width: int, console: Console) -> list[str]:
    return [line.plain.rstrip() for line in Text(cell).wrap(console, width, overflow="fold")]


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    filled = (cell + " " * (width - cell_len(cell)) for cell, width in zip(cells, widths, strict=True))
    return GAP.join(filled).rstrip()
