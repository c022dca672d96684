"""The directive `command-tables`: every command with its arguments and options, taken from the program itself."""

from collections.abc import Iterator
from typing import Any

import typer
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from typer.core import TyperGroup

from labctl.commands.main import app


class CommandTables(SphinxDirective):
    """One section a command: what it does, then a table of what it takes."""

    def run(self) -> list[nodes.Node]:
        """The sections."""
        lines: list[str] = []
        for name, command in _commands(typer.main.get_command(app), "labctl"):
            lines += [f"## {name}", "", *(command.help or "").splitlines(), ""]
            taken = [parameter for parameter in command.params if not getattr(parameter, "hidden", False)]
            if taken:
                lines += ["| takes | what it is |", "|---|---|", *map(_row, taken), ""]
        return self.parse_text_to_nodes(StringList(lines, "labctl --help"), allow_section_headings=True)


def _commands(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    if not isinstance(command, TyperGroup):
        yield name, command
        return
    context = typer.Context(command)
    for word in command.list_commands(context):
        _, found, _ = command.resolve_command(context, [word])
        yield from _commands(found, f"{name} {word}")


def _row(parameter: Any) -> str:
    argument = parameter.param_type_name == "argument"
    names = parameter.name.upper() if argument else ", ".join((*parameter.opts, *parameter.secondary_opts))
    text = (parameter.help or "").replace("|", "\\|")
    return f"| `{names}` | {text} |"


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.add_directive("command-tables", CommandTables)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
