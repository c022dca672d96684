"""Every header our Tektronix drivers send stands in the manufacturer's own command tree (tm_devices).

The package belongs to the environment of `make interop`, which runs this module; elsewhere it is skipped.
"""

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.checkout import ROOT

pytest.importorskip("tm_devices", reason="tm_devices is absent: `make interop` runs this")

DRIVERS = ROOT / "instruments"
HEADER = re.compile(r":?(\*[A-Z]{2,4}|[A-Z\x00][\w\x00]*(?::[\w\x00]+)+|[A-Z]{2,}[a-z]*(?=\?$| [A-Z]+$))(?=[ ?]|$)")
PLACE = "\x00"
"""Stands for what an f-string fills in."""


def headers(driver: str) -> list[str]:
    """Headers in the strings of a driver, `\\x00` where a value is filled in."""
    return [header for module in DRIVERS.glob(f"{driver}*.py") for header in headers_of(module)]


def headers_of(module: Path) -> list[str]:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    documented = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    texts = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [str(part.value) if isinstance(part, ast.Constant) else PLACE for part in node.values]
            texts.append("".join(parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and not {id(node)} & (documented | inside):
            texts.append(node.value)
    units = [unit.strip() for text in texts for unit in text.split(";")]
    return sorted({match[1] for unit in units if (match := HEADER.match(unit))})


def known(node: Any, seen: set[int]) -> Iterator[str]:
    """Every header of a command tree, suffixes as 1."""
    if id(node) in seen or not hasattr(node, "__dict__"):
        return
    seen.add(id(node))
    if syntax := getattr(node, "_cmd_syntax", ""):
        yield syntax.upper()
        yield syntax.upper().replace(":LEVEL:IMMEDIATE", "")  # two nodes that may always be left out
    for child in vars(node).values():
        if isinstance(child, dict):
            yield from known(child[1], seen)
        elif type(child).__module__.startswith("tm_devices.commands"):
            yield from known(child, seen)


def tree_of(family: str) -> set[str]:
    """Every header of a family."""
    commands = importlib.import_module(f"tm_devices.commands.{family.lower()}_commands")
    tree = set(known(getattr(commands, f"{family}Commands")(None), set()))
    assert len(tree) > 300
    return tree


def test_the_virtual_6_series_has_headers_of_its_family() -> None:
    source = (DRIVERS.parent / "sim_backends" / "virtual" / "mso6b" / "commands.py").read_text("utf-8")
    declared = re.findall(r'(?:Setting|Query|Action)\(\s*"([A-Z][^"?]+)', source)
    assert len(declared) > 60
    tree = tree_of("MSO6B")
    assert [header for header in declared if header.upper().replace("#", "1") not in tree] == []


@pytest.mark.parametrize(
    ("driver", "family"),
    [("tektronix_awg70002a", "AWG70KA"), ("tektronix_dpo72504dx", "DPO70KDX"), ("tektronix_mso6b", "MSO6B")],
)
def test_headers_are_the_manufacturers(driver: str, family: str) -> None:
    tree = tree_of(family)
    sent = headers(driver)
    assert len(sent) > 15
    # the settings of a channel stand in the driver without their `CH<x>:`
    patterns = {header: "(?:CH1:)?" + re.escape(header.upper()).replace("\x00", r"\w+") for header in sent}
    strange = [header for header, pattern in patterns.items() if not any(re.fullmatch(pattern, one) for one in tree)]
    assert strange == []
