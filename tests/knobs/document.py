"""The table of outcomes: `python -m tests.knobs.document` carries out every case and writes it.

It writes `docs/reference/wrong-data.md` of the checkout it runs in; the tests compare every case with what stands
there.
"""

import logging
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

from tests.knobs.lies import BEFORE, LIES
from tests.knobs.settings import KNOBS, Knob
from tests.knobs.table import (
    ENDED,
    MARKED,
    MENDED,
    MODES,
    NAMED,
    REFUSED,
    RIGHT,
    WRONG,
    Case,
    carried_out,
    cases,
    outcome,
    undisturbed,
)
from tests.supervisors import none_left

DOCUMENT = Path("docs/reference/wrong-data.md")
NOTHING = "-"
WHAT = "what happens"

_INTRODUCTION = f"""\
# Changed settings and wrong data

How a run reacts when another client, or a person at the front panel, changes a setting while it goes on, and when an
instrument answers in order but gives wrong data (*a lie*). Each case is a small run on a simulated bench, over real
sockets. The change comes at one moment of the run, and stays.

| outcome | meaning |
| --- | --- |
| {RIGHT} | The run ends well, and every record is that of a run without it. |
| {MENDED} | The same, after records were measured again. |
| {MARKED} | The run ends well, and every record that differs is marked `suspect`. |
| {ENDED} | Exit status 1 and one line. The kept records are right or marked, also after `labctl resume`. |
| {NAMED} | As *ends*, and the line names the setting. |
| {REFUSED} | As *ends*, before anything was measured. |

The moments: {BEFORE}; *ranging*: at the first acquisition; *between records*: before an acquisition in the middle of
the first pass, in a burst run before a burst; *before the picture*: when the oscilloscope waits and the DMD starts;
*between channels*: before the points of the last channel are asked for; *next pass*: when the second pass is patched;
*last record*: before the last acquisition. `{NOTHING}`: the setting does nothing then, or cannot be changed. A picture
from another process cannot reach the DMD, since the vendor's library gives a device to one process alone.

This document is generated: `python -m tests.knobs.document`.
"""


def document(outcomes: Mapping[str, str]) -> str:
    """The whole document; `outcomes` by the identifiers of the cases."""
    told = "; ".join(f"{name}: {count}" for name, count in Counter(outcomes.values()).most_common())
    counted = f"{len(KNOBS)} settings, {len(LIES)} lies, {len(outcomes)} cases. {told[0].upper()}{told[1:]}.\n"
    parts = [_INTRODUCTION, counted]
    for section, of_section in _sections().items():
        whens = list(dict.fromkeys(when for _, when in of_section))
        heads = f"| {section}: {WHAT} | {' | '.join(whens)} |\n| --- |{' --- |' * len(whens)}"
        found = {key: outcomes[identifier] for key, identifier in of_section.items()}
        rows = [
            f"| {name} | {' | '.join(found.get((name, when), NOTHING) for when in whens)} |"
            for name in dict.fromkeys(name for name, _ in found)
        ]
        parts.append("\n".join([f"## {section}", "", heads, *rows, ""]))
    return "\n".join(parts)


def documented(text: str) -> dict[str, str]:
    """The outcomes that stand in a document, by the identifiers of the cases."""
    cells: dict[tuple[str, str, str], str] = {}
    section, whens = "", list[str]()
    for line in text.splitlines():
        if line.startswith("## "):
            section = line.removeprefix("## ")
        elif section and line.startswith(f"| {section}: {WHAT} | "):
            whens = line.strip("| ").split(" | ")[1:]
        elif line.startswith("| ") and line.count(" | ") == len(whens) > 0:
            name, *row = line.strip("| ").split(" | ")
            cells |= {(section, name, when): cell for when, cell in zip(whens, row, strict=True)}
    return {
        identifier: cells[(section, *key)]
        for section, of_section in _sections().items()
        for key, identifier in of_section.items()
        if (section, *key) in cells
    }


def main(root: Path = Path()) -> int:
    """Carry out every case and write the document below `root`; 1 if there are wrong records that are not marked."""
    logging.disable()
    outcomes = dict(_outcomes())
    (root / DOCUMENT).write_text(document(outcomes), encoding="utf-8")
    return int(WRONG in outcomes.values())


def _sections() -> dict[str, dict[tuple[str, str], str]]:
    """The identifiers of the cases by name and moment, by section, in the order of the document."""
    sections: dict[str, dict[tuple[str, str], str]] = {}
    for cause, mode, when in (whole := list(cases())):
        kind = "a setting changed" if isinstance(cause, Knob) else "a lie"
        of_section = sections.setdefault(f"{cause.role}, {mode}, {kind}", {})
        of_section[cause.name, when] = Case(cause, mode, when).identifier
    assert sum(map(len, sections.values())) == len(whole)
    return sections


def _outcomes() -> Iterator[tuple[str, str]]:
    expected = {}
    for mode in MODES:
        with tempfile.TemporaryDirectory() as folder:
            expected[mode] = undisturbed(mode, Path(folder))
    for case in cases():
        with tempfile.TemporaryDirectory() as folder, none_left():
            try:
                found = outcome(case, carried_out(case, expected[case.mode], Path(folder)), expected)
            except AssertionError as error:
                sys.stderr.write(f"{error}\n")
                found = WRONG
        sys.stderr.write(f"{case.identifier}: {found}\n")
        yield case.identifier, found


if __name__ == "__main__":
    sys.exit(main())
