"""Tables as people read them: nothing is lost, nothing is longer than the line, and columns stand below each other."""

import io

from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from labctl.commands.columns import GAP, in_columns

CELLS = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "S"), include_characters=" "), max_size=30)
TABLES = st.integers(1, 5).flatmap(
    lambda columns: st.lists(st.lists(CELLS, min_size=columns, max_size=columns), min_size=1, max_size=6)
)


def printed(rows: list[list[str]], width: int) -> list[str]:
    return list(in_columns(rows, Console(file=io.StringIO(), width=width)))


@given(TABLES, st.integers(20, 200))
def test_no_line_is_longer_than_the_console_is_wide(rows: list[list[str]], width: int) -> None:
    assert all(cell_len(line) <= width for line in printed(rows, width))


@given(TABLES, st.integers(20, 200))
def test_no_sign_is_lost(rows: list[list[str]], width: int) -> None:
    shown = "".join(printed(rows, width)).replace(" ", "")
    assert sorted(shown) == sorted("".join(cell for row in rows for cell in row).replace(" ", ""))


def test_columns_stand_below_each_other() -> None:
    assert printed([["run", "shots"], ["a longer name", "6/6"]], 80) == ["run            shots", "a longer name  6/6"]


def test_the_widest_column_yields_and_goes_on_below() -> None:
    address = "TCPIP0::awg.lab.example::inst0::INSTR"
    lines = printed([["awg", address, "ok"]], 30)
    assert len(lines) == 2
    assert lines[0].startswith(f"awg{GAP}TCPIP0::")
    assert lines[0].endswith(f"{GAP}ok")
    assert "".join(line.split(GAP)[1] if n == 0 else line.strip() for n, line in enumerate(lines)) == address
