"""What labctl claims about speed, as one table: each figure, its reference of the same run, the ratio, and the goal.

    python -m benchmarks [NAME ...] [--json | --markdown]

Names are those of the modules in this folder that have `rows`; all of them without names. Each is measured in a process
of its own, so that none warms up another. Exit 1 if a goal is not reached or something could not be measured.
"""

import argparse
import importlib
import json
import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parent
ONE = "--one"
HEADINGS = ("benchmark", "what", "figure", "by processor", "reference", "ratio", "goal", "")


def names() -> list[str]:
    """The modules that measure."""
    return sorted(path.stem for path in HERE.glob("*.py") if "\ndef rows(" in path.read_text("utf-8"))


def measured(name: str) -> list[dict[str, object]] | None:
    """The rows of one module, made in a process of its own; None if it ended with an error."""
    command = [sys.executable, "-m", "benchmarks", ONE, name]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)  # noqa: S603
    return [json.loads(line) for line in done.stdout.splitlines()] if done.returncode == 0 else None


def measure_here(name: str) -> None:
    """Measure in this process and print one JSON object a row."""
    for row in importlib.import_module(f"benchmarks.{name}").rows():
        sys.stdout.write(json.dumps({"benchmark": name, **row.as_json(), "goal": row.goal and str(row.goal)}) + "\n")


def number(value: object, unit: object = "") -> str:
    """A figure as a cell: three digits; empty for none."""
    if not isinstance(value, int | float):
        return ""
    return f"{value:,.0f} {unit}".strip() if abs(value) >= 1000 else f"{value:.3g} {unit}".strip()


def cells(row: dict[str, object]) -> tuple[str, ...]:
    """A row as people read it, by the words of `HEADINGS`."""
    return (
        str(row["benchmark"]),
        str(row["what"]),
        number(row["figure"], row["unit"]),
        number(row["processor"], row["unit"]),
        f"{number(row['reference'], row['unit'])} {row['against']}".strip(),
        number(row["ratio"]),
        str(row["goal"] or ""),
        {True: "reached", False: "NOT REACHED", None: ""}[row["reached"]],  # type: ignore[index]
    )


def table(rows: list[dict[str, object]]) -> Table:
    """For a terminal."""
    drawn = Table(*HEADINGS)
    for row in rows:
        drawn.add_row(*cells(row))
    return drawn


def markdown(rows: list[dict[str, object]]) -> str:
    """For a document."""
    lines = [HEADINGS, ("---",) * len(HEADINGS), *map(cells, rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", choices=[*names(), []], metavar="NAME", help=", ".join(names()))
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="one JSON object on standard output")
    form.add_argument("--markdown", action="store_true", help="a table for a document")
    parser.add_argument(ONE, choices=names(), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        measure_here(given.one)
        return 0
    rows, failed = [], []
    for name in given.names or names():
        sys.stderr.write(f"measuring {name}\n")
        found = measured(name)
        rows += found or []
        failed += [] if found is not None else [name]
    if given.json:
        sys.stdout.write(json.dumps({"rows": rows, "not_measured": failed}) + "\n")
    elif given.markdown:
        sys.stdout.write(markdown(rows))
    else:
        Console(width=200 if not sys.stdout.isatty() else None).print(table(rows))
    if failed:
        sys.stderr.write(f"could not be measured: {', '.join(failed)}; the reason is above\n")
    return int(bool(failed) or any(row["reached"] is False for row in rows))


if __name__ == "__main__":
    sys.exit(main())
