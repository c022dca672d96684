"""What the virtual instruments understand and what they lack, as documents made from their tables of commands.

`python -m sim_backends.virtual.catalogue` writes `docs/reference/virtual-instruments.md` and
`docs/reference/not-simulated.md` of the checkout it runs in.
"""

import sys
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from sim_backends import virtual
from sim_backends.scpi.commands import Command
from sim_backends.virtual import VirtualInstrument
from sim_backends.virtual.dlpc900 import commands as dlpc900
from sim_backends.virtual.instrument import COMMON
from sim_backends.virtual.tlg220.instrument import default_table

DOCUMENT = Path("docs/reference/virtual-instruments.md")
LACKING = Path("docs/reference/not-simulated.md")

WORKS = "works"
WITHOUT_EFFECT = "accepted without effect"

_INTRODUCTION = """\
# Virtual instruments

Every command the virtual instruments understand. Capitals are the short form, `[...]` may be left out, `#` stands for
a numeric suffix. *Accepted without effect*: the value is checked, kept and read back, and nothing else changes. Any
other command gets the error that the model gives for an unknown one: -113, or 113 on the oscilloscope. If real
instruments of the family have the header, the error says so: [not simulated](not-simulated.md). The DLPC900 has
numbers for commands, and refuses others with its error 3.

This document is generated: `python -m sim_backends.virtual.catalogue`.
"""

_WHAT_IS_LACKING = """\
# Not simulated

Headers that instruments of these families have by their maker's own list, and that the virtual instruments lack. They
get the error for an unknown header, -113 or 113, with a text of their own: `Undefined header; CURSor:FUNCtion is a real
header that is not simulated`. The log of the simulated bench has a line too. A header that does not exist
gets the plain error.

The lists come from the command tree of the package [tm_devices](https://github.com/tektronix/tm_devices), which has the
Apache License 2.0: only names, and whether there is a command and a query. `#` stands for a numeric suffix.

This document is generated: `python -m sim_backends.virtual.catalogue`.
"""


def models() -> dict[str, type[VirtualInstrument]]:
    """Every virtual instrument by its class name."""
    found = {name: getattr(virtual, name) for name in virtual.__all__}
    return {
        name: model
        for name, model in found.items()
        if isinstance(model, type) and issubclass(model, VirtualInstrument) and model is not VirtualInstrument
    }


def states(commands: Sequence[Command]) -> list[tuple[str, str, str]]:
    """One line a command: header, forms (`set`, `query`, `set and query`) and state, in the order of the headers."""
    forms: dict[str, set[str]] = {}
    state: dict[str, str] = {}
    for command in commands:
        meant = forms.setdefault(command.header, set())
        meant.update(form for form, there in (("set", command.acts), ("query", command.answers)) if there)
        state[command.header] = WORKS if command.effect else WITHOUT_EFFECT
    lines = [(header, " and ".join(sorted(meant, reverse=True)), state[header]) for header, meant in forms.items()]
    return sorted(lines, key=lambda line: line[0].replace("[", "").upper())


def document() -> str:
    """The whole document."""
    parts = [_INTRODUCTION, _section("Common to all", "", states(COMMON))]
    for name, model in models().items():
        if model.COMMANDS:
            parts.append(_section(name, model.IDENTITY, states(model.COMMANDS)))
        else:
            parts.append(_laser_section(name, model.IDENTITY, default_table()))
    parts.append(_section("VirtualDlpc900", "", dlpc900.states()))
    return "\n".join(parts)


def missing(model: type[VirtualInstrument]) -> list[tuple[str, str]]:
    """Headers of the model's family that it lacks, and which forms of each."""
    forms: dict[str, list[str]] = {}
    for header, query in model.lacks():
        forms.setdefault(header, []).append("query" if query else "set")
    return [(header, " and ".join(lacked)) for header, lacked in forms.items()]


def lacking() -> str:
    """The whole document of what is not simulated."""
    parts = [_WHAT_IS_LACKING]
    for name, model in models().items():
        if model.FAMILY:
            rows = missing(model)
            headers = len({header for header, _ in model.FAMILY})
            parts.append(f"## {name}\n\n{len(rows)} of {headers} headers.\n")
            for subsystem, group in groupby(rows, key=lambda row: row[0].partition(":")[0]):
                lines = "\n".join(f"| `{header}` | {forms} |" for header, forms in group)
                parts.append(f"### {subsystem}\n\n| header | not simulated |\n| --- | --- |\n{lines}\n")
    return "\n".join(parts)


def main(root: Path = Path()) -> int:
    """Write both documents below `root`."""
    (root / DOCUMENT).write_text(document(), encoding="utf-8")
    (root / LACKING).write_text(lacking(), encoding="utf-8")
    return 0


def _section(name: str, identity: str, lines: Sequence[tuple[str, str, str]]) -> str:
    counts = {state: sum(line[2] == state for line in lines) for state in (WORKS, WITHOUT_EFFECT)}
    summary = ", ".join(f"{count} {state}" for state, count in counts.items() if count)
    rows = "\n".join(f"| `{header}` | {forms} | {state} |" for header, forms, state in lines)
    heading = f"## {name}\n\n" + (f"`{identity}`\n\n" if identity else "")
    return f"{heading}{summary}.\n\n| command | forms | state |\n| --- | --- | --- |\n{rows}\n"


def _laser_section(name: str, identity: str, table: Mapping[str, Any]) -> str:
    rows = "\n".join(f"| `{entry['write'].strip()}` | {key} | {WORKS} |" for key, entry in table["commands"].items())
    heading = (
        f"## {name}\n\n`{identity}`\n\nIts commands are a table, by default these; see the laser table's own file."
    )
    return f"{heading}\n\n| written | entry | state |\n| --- | --- | --- |\n{rows}\n"


if __name__ == "__main__":
    sys.exit(main())
