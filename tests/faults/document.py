"""The table of outcomes: `python -m tests.faults.document` carries out the whole matrix and writes it.

It writes `docs/reference/faults.md` of the checkout it runs in; the tests compare every case with what stands there.
"""

import logging
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path

from labctl.engine.recovery import ATTEMPTS, PAUSE_S
from tests.faults.matrix import (
    CLIPPED,
    ENDED,
    LEFT,
    NO_HARM,
    PHASES,
    RECOVERED,
    UNCONFIRMED,
    Case,
    Ended,
    Way,
    carried_out,
    cases,
    outcome,
    undisturbed,
)
from tests.supervisors import none_left

DOCUMENT = Path("docs/reference/faults.md")
NOTHING = "-"

_INTRODUCTION = f"""\
# Faults

How a run reacts to faults of its instruments. Each case is a small acquisition on a simulated bench, over real
sockets, in which one fault strikes one instrument at a message of the phase named, once unless it says otherwise.
With `labctl sim serve --fault` you can [try the same faults](../how-to/break-the-bench-on-purpose.md) on any client.

| outcome | meaning |
| --- | --- |
| {NO_HARM} | The run ends well, and its frames are those of a run without the fault. |
| {RECOVERED} | The same, after all instruments were reached again and the missing shots were measured. |
| {CLIPPED} | The run ends well and says how many records touch the end of the range. |
| {ENDED} | Exit status 1, one line that names the instrument; acknowledged shots are kept, the safe state is reached. |
| {UNCONFIRMED} | As *ends*, but the instrument does not confirm the safe state, and the line says so. |
| {LEFT} | As *ends, unconfirmed*, but the instrument receives nothing: it stays as it was, all others are safe. |

The safe state is looked up in the simulated world, not in a driver: laser dark, AWG off, DMD blank, oscilloscope
stopped. Cases of amplifier, attenuator and power meter have these three on the bench: attenuator shut, amplifier off. A
laser or an amplifier that is left as it was still emits: the line says so and names its switch. After a lost link an
instrument gets its command once more through a new connection, and the run tries to reach the bench again at
most {ATTEMPTS} times in a row without a new record between, {PAUSE_S:g} s apart; `commands.log` has a line for each.
The patch panel gets no command at the end of a run.

Instruments that answer in order but give wrong data, and settings that somebody else changes, are in [a table of their
own](wrong-data.md).

This document is generated: `python -m tests.faults.document`.
"""


def document(outcomes: Mapping[str, str]) -> str:
    """The whole document; `outcomes` by the identifiers of the cases."""
    whole = list(cases())
    parts = [_INTRODUCTION, _counts([outcomes[case.identifier] for case in whole])]
    for role, of_role in groupby(sorted(whole, key=lambda case: case.place), key=lambda case: case.place):
        heads = f"| {role}: fault | {' | '.join(PHASES)} |\n| --- |{' --- |' * len(PHASES)}"
        rows = [
            f"| {name}: {told} | {' | '.join(_cells(group, outcomes))} |"
            for (name, told), group in _rows(list(of_role)).items()
        ]
        parts.append("\n".join([f"## {role}", "", heads, *rows, ""]))
    return "\n".join(parts)


def documented(text: str) -> dict[str, str]:
    """The outcomes that stand in a document, by the identifiers of the cases."""
    found: dict[str, str] = {}
    cells: dict[tuple[str, str, str], str] = {}
    role = ""
    for line in text.splitlines():
        if line.startswith("## "):
            role = line.removeprefix("## ")
        elif line.startswith("| ") and line.count(" | ") == len(PHASES):
            name, *row = line.strip("| ").split(" | ")
            cells |= {(role, name, phase): cell for phase, cell in zip(PHASES, row, strict=True)}
    for case in cases():
        cell = cells.get((case.place, f"{case.name}: {case.fault.told}", case.phase))
        if cell is not None:
            found[case.identifier] = cell
    return found


def main(root: Path = Path()) -> int:
    """Carry out every case and write the document below `root`."""
    logging.disable()
    outcomes = dict(_outcomes())
    (root / DOCUMENT).write_text(document(outcomes), encoding="utf-8")
    return 0


def _outcomes() -> Iterator[tuple[str, str]]:
    expected: dict[Way, Ended] = {}
    for case in cases():
        if case.way not in expected:
            with tempfile.TemporaryDirectory() as folder:
                expected[case.way] = undisturbed(Path(folder), case)
        with tempfile.TemporaryDirectory() as folder, none_left():
            found = outcome(case, carried_out(case, Path(folder)), expected[case.way])
        sys.stderr.write(f"{case.identifier}: {found}\n")
        yield case.identifier, found


def _counts(found: list[str]) -> str:
    told = "; ".join(f"{name}: {count}" for name, count in Counter(found).most_common())
    return f"{len(found)} cases. {told[0].upper()}{told[1:]}.\n"


def _rows(of_role: list[Case]) -> dict[tuple[str, str], list[Case]]:
    rows: dict[tuple[str, str], list[Case]] = {}
    for case in of_role:
        rows.setdefault((case.name, case.fault.told), []).append(case)
    return rows


def _cells(row: list[Case], outcomes: Mapping[str, str]) -> list[str]:
    found = {case.phase: outcomes[case.identifier] for case in row}
    return [found.get(phase, NOTHING) for phase in PHASES]


if __name__ == "__main__":
    sys.exit(main())
