"""What the documents say to type can be typed: every command, option and setting in them is the program's."""

import re
import shlex
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest
from typer import Context
from typer.core import TyperGroup
from typer.main import get_command

from labctl.bench.schema import names
from labctl.commands.main import app
from protocols.registry import read_protocol
from tests.checkout import PAGES, README, ROOT

BLOCK = re.compile(r"^ *```(\S*)[^\n]*\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
LINE = re.compile(r"^ *(?:\$ )?labctl ([^:].*)", re.MULTILINE)
SPAN = re.compile(r"`labctl ([^`]+)`")
ROW = re.compile(r"^\| (`labctl .*?`) \|", re.MULTILINE)
OPTION = re.compile(r"--[a-z][a-z-]*")


@cache
def resolved(*words: str) -> tuple[Any, tuple[str, ...]]:
    """The command that some words name, and the words behind it."""
    command: Any = get_command(app)
    rest = list(words)
    while isinstance(command, TyperGroup) and rest and not rest[0].startswith("-"):
        _, command, rest = command.resolve_command(Context(command), rest)
    return command, tuple(rest)


def options_of(command: Any) -> set[str]:
    """What a command takes, as it is typed."""
    found = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    return {name for name in found if name.startswith("--")} | {"--help"}


LINES = [
    pytest.param(line, id=f"{page.stem}: {line}")
    for page in (*PAGES, README)
    for language, block in BLOCK.findall(page.read_text("utf-8"))
    if language in ("", "{typed}")
    for line in LINE.findall(block)
]
SPANS = [
    pytest.param(span.replace("\\|", "|"), id=f"{page.stem}: {span}")
    for page in (*PAGES, README)
    for span in SPAN.findall(page.read_text("utf-8"))
]


def check(words: list[str]) -> None:
    command, rest = resolved(*words)
    if isinstance(command, TyperGroup):
        assert set(rest) <= options_of(command)
        return
    given = command.make_context(command.name, list(rest)).params
    if "protocol" in given and given["protocol"] in names():
        read_protocol(given["protocol"], given["settings"] or [])
    if given.get("command"):  # of `record` and `replay`
        check(list(given["command"]))


@pytest.mark.parametrize("line", LINES)
def test_a_line_to_type_is_taken(line: str) -> None:
    check(shlex.split(line, comments=True))


@pytest.mark.parametrize("span", SPANS)
def test_a_command_in_the_text_has_these_options(span: str) -> None:
    words = [match[0] if (match := re.match("-*[a-z-]+", word)) else word for word in span.split()]
    command, _ = resolved(*words)
    assert set(OPTION.findall(span.partition(" -- ")[0])) <= options_of(command)


def leaves(*words: str) -> Iterator[tuple[str, Any]]:
    """Every command that does something, by its words."""
    command, _ = resolved(*words)
    if not isinstance(command, TyperGroup):
        yield " ".join(words), command
        return
    for word in command.list_commands(Context(command)):
        yield from leaves(*words, word)


@pytest.mark.parametrize(("words", "command"), [pytest.param(*leaf, id=leaf[0]) for leaf in leaves()])
def test_the_reference_names_every_command_with_all_its_options(words: str, command: Any) -> None:
    rows = ROW.findall((ROOT / "docs" / "reference" / "commands.md").read_text("utf-8"))
    told = [row for row in rows if re.search(rf"`labctl {words}[ `]", row)]
    assert told
    assert options_of(command) - {"--help", "--json"} <= set(OPTION.findall(" ".join(told)))
