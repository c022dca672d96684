"""Commands that are known by name and loaded when they are asked for: to list them imports none of them."""

import pkgutil
import re
from importlib.util import find_spec
from itertools import pairwise, takewhile
from typing import Any, cast

from typer import Typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from labctl.commands import COMMANDS
from labctl.errors import UsageError, notes

PLAIN: dict[str, Any] = {"rich_markup_mode": None, "pretty_exceptions_enable": False}
"""How every command prints its help and fails: as plain text, and by `labctl.commands.main`."""
DOCSTRING = re.compile(r'"""(.+?)("""|$)', re.MULTILINE)
"""Its first line: to parse every command's source takes longer than all else that help needs."""


class Named(TyperCommand):
    """A command whose `--out` has a name: an empty one, of a variable the shell lacks, would be the present folder."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line; those behind `--` are no options.

        Raises:
            UsageError: `--out` is empty.
        """
        options = list(takewhile("--".__ne__, args))
        if "--out=" in options or ("--out", "") in pairwise(options):
            raise UsageError("--out is empty: name what to make (the shell may not know its variable), or leave it out")
        return super().parse_args(ctx, args)


class Unloaded(TyperCommand):
    """A command by its name and its place, "module:function" or "module:app"; enough to be listed and completed."""

    def __init__(self, name: str, place: str) -> None:
        """Nothing is imported yet."""
        super().__init__(name)
        self._place = place

    def get_short_help_str(self, limit: int = 45) -> str:
        """The first line of its help; whole, whatever `limit` says, since lists wrap their lines."""
        return first_line(self._place)

    def load(self) -> TyperCommand | TyperGroup:
        """The command itself, its module imported."""
        app = pkgutil.resolve_name(self._place)
        if not isinstance(app, Typer):
            function, app = app, Typer(add_completion=False, **PLAIN)
            app.command(self.name, cls=Named)(function)
        return cast(TyperCommand | TyperGroup, get_command(app))


class Stopped(Exception):
    """The operator stopped a command; `args` are the notes on that."""


class UnloadedCommands(TyperGroup):
    """The group of `COMMANDS`: one of them is loaded when it is run, or asked for its own help or completion."""

    def __init__(self, **described: Any) -> None:
        """What typer says of the group, with the table's commands."""
        commands = {name: Unloaded(name, place) for name, place in COMMANDS.items()}
        super().__init__(**(described | {"commands": commands}))

    def resolve_command(
        self, ctx: Any, args: list[str]
    ) -> tuple[str | None, TyperCommand | TyperGroup | None, list[str]]:
        """The command that `args` begin with, loaded, and what follows it."""
        name, found, rest = super().resolve_command(ctx, args)
        return name, found.load() if isinstance(found, Unloaded) else None, rest

    def invoke(self, ctx: Any) -> Any:
        """Carry the command out.

        Raises:
            Stopped: The operator stopped it. typer would make a status of that, and lose what is noted on it.
        """
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            raise Stopped(*notes(stop)) from stop


def first_line(place: str) -> str:
    """First line of the docstring of "module:function", or of the module for "module:app"; imports neither."""
    module, _, name = place.partition(":")
    spec = find_spec(module)
    source = cast(Any, spec.loader).get_source(module) if spec is not None else None
    begin = f"\n{source}".find(f"\ndef {name}(")
    found = DOCSTRING.search(source or "", max(begin, 0))
    return found[1] if found else ""
