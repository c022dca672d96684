"""`python -m tests.truth.families` writes the lists of headers that the Tektronix twins know their families by.

It runs in the environment of `make interop`, which has tm_devices; the twins read the lists without it.
"""

import sys
from pathlib import Path

from tests.checkout import ROOT
from tests.truth.descriptions import FAMILIES, Described, described, version

PACKAGES = {"scope": "dpo72504dx", "awg": "awg70002a"}

_HEAD = """\
% Headers of the family {family} by its maker: facts taken from the command tree of the Python package
% tm_devices {version} (https://github.com/tektronix/tm_devices, Apache License 2.0), nothing of its texts.
% Written by `python -m tests.truth.families`; sim_backends/scpi/family.py says how it is read.
"""


def path(role: str) -> Path:
    """Where the list of a role's family lies."""
    return ROOT / "sim_backends" / "virtual" / PACKAGES[role] / "family.txt"


def listed(role: str) -> str:
    """The list of a role's family."""
    lines: list[str] = []
    before: list[str] = []
    for header in described(FAMILIES[role]).values():
        nodes = header.name.split(":")
        shared = next((i for i, (one, other) in enumerate(zip(nodes, before, strict=False)) if one != other), None)
        shared = min(len(nodes), len(before)) if shared is None else shared
        lines += [" " * level + node for level, node in enumerate(nodes[:-1]) if level >= shared]
        lines.append(" " * (len(nodes) - 1) + f"{nodes[-1]} {_marks(header)}")
        before = nodes
    return _HEAD.format(family=FAMILIES[role], version=version()) + "\n".join(lines) + "\n"


def _marks(header: Described) -> str:
    return ("!" if header.command else "") + ("?" if header.query else "")


def main() -> int:
    """Write both lists."""
    for role in FAMILIES:
        path(role).write_text(listed(role), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
