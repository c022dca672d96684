"""What the virtual instruments understand, as a document: every command with its state.

`python -m sim_backends.virtual.catalogue` writes `docs/reference/virtual-instruments.md` of the checkout it runs in. A
command works, is accepted without effect, or is known from the real instrument's manual and not there.
"""

import re
import sys
import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from sim_backends import virtual
from sim_backends.scpi.commands import Command
from sim_backends.virtual import VirtualInstrument
from sim_backends.virtual.instrument import COMMON
from sim_backends.virtual.tlg220.instrument import default_table

DOCUMENT = Path("docs/reference/virtual-instruments.md")

WORKS = "works"
WITHOUT_EFFECT = "accepted without effect"
MISSING = "not there"

_INTRODUCTION = """\
# Virtual instruments

Every command the virtual instruments understand. Capitals are the short form, `[...]` may be left out, `#` stands for
a numeric suffix. *Accepted without effect*: the value is checked, kept and read back, and nothing else changes.
*Not there*: the real instrument's manual has it, the virtual one answers -113 (113 on the oscilloscope).

This document is generated: `python -m sim_backends.virtual.catalogue`.
"""


def known_commands() -> dict[str, dict[str, list[str]]]:
    """For some models: headers the real instrument is known to have, and those that are here without effect."""
    return tomllib.loads(files("sim_backends.virtual").joinpath("known_commands.toml").read_text(encoding="utf-8"))


def models() -> dict[str, type[VirtualInstrument]]:
    """Every virtual instrument by its class name."""
    found = {name: getattr(virtual, name) for name in virtual.__all__}
    return {
        name: model
        for name, model in found.items()
        if isinstance(model, type) and issubclass(model, VirtualInstrument) and model is not VirtualInstrument
    }


def states(commands: Sequence[Command], known: Mapping[str, Sequence[str]]) -> list[tuple[str, str, str]]:
    """One line a command: header, forms (`set`, `query`, `set and query`) and state, in the order of the headers.

    Args:
        commands: The table of a model.
        known: `known`, headers of the real instrument; `without_effect`, headers of this table.
    """
    forms: dict[str, set[str]] = {}
    for command in commands:
        meant = forms.setdefault(command.header, set())
        meant.update(form for form, there in (("set", command.acts), ("query", command.answers)) if there)
    idle = set(known.get("without_effect", ()))
    present = [_pattern(header) for header in forms]
    lines = [
        (header, " and ".join(sorted(meant, reverse=True)), WITHOUT_EFFECT if header in idle else WORKS)
        for header, meant in forms.items()
    ]
    lines += [
        (header, "", MISSING)
        for header in known.get("known", ())
        if not any(pattern.fullmatch(header.upper()) for pattern in present)
    ]
    return sorted(lines, key=lambda line: line[0].replace("[", "").upper())


def document() -> str:
    """The whole document."""
    parts = [_INTRODUCTION, _section("Common to all", "", states(COMMON, {}))]
    known = known_commands()
    for name, model in models().items():
        if model.COMMANDS:
            parts.append(_section(name, model.IDENTITY, states(model.COMMANDS, known.get(name, {}))))
        else:
            parts.append(_laser_section(name, model.IDENTITY, default_table()))
    return "\n".join(parts)


def main(root: Path = Path()) -> int:
    """Write the document below `root`."""
    (root / DOCUMENT).write_text(document(), encoding="utf-8")
    return 0


def _section(name: str, identity: str, lines: Sequence[tuple[str, str, str]]) -> str:
    counts = {state: sum(line[2] == state for line in lines) for state in (WORKS, WITHOUT_EFFECT, MISSING)}
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


def _pattern(header: str) -> re.Pattern[str]:
    """Matches a declared header with its optional nodes present or left out."""
    return re.compile(re.escape(header.upper()).replace(r"\[", "(?:").replace(r"\]", ")?"))


if __name__ == "__main__":
    sys.exit(main())
