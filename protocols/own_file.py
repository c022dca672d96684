"""A protocol in a Python file that whoever types a command names: his own code, executed as such, kept with the run.

Nothing that comes as data may lead here: no manifest, no TOML file, no name from a browser.
"""

import inspect
import os
import re
import sys
from errno import ENOENT
from importlib.abc import ExecutionLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from traceback import walk_tb
from types import ModuleType
from typing import Any

from instruments.remedies import unreadable
from instruments.toml_files import LARGEST_FILE
from protocols.base import Measurement, ProtocolError, SourceFile

SUFFIX = ".py"
NAME = re.compile(r"[a-z][a-z0-9-]{0,39}")


class _Text(ExecutionLoader):
    """Executes a text that was read before: what is kept with the run is what was carried out."""

    def __init__(self, file: SourceFile) -> None:
        self.file = file

    def get_source(self, fullname: str) -> str:
        return self.file.text

    def get_filename(self, fullname: str) -> str:
        return str(self.file.path)


def read_source(path: Path) -> SourceFile:
    """A Python file as it is now; nothing of it is executed.

    Raises:
        ProtocolError: it cannot be read, or is larger than 64 KiB.
    """
    try:
        if not path.is_file():  # a FIFO has no end
            raise FileNotFoundError(ENOENT, os.strerror(ENOENT), str(path))
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise ProtocolError(unreadable(path, error, "name a protocol or a protocol file")) from None
    if len(content) > LARGEST_FILE:
        raise ProtocolError(f"{path}: is larger than {LARGEST_FILE} bytes: install it as a package, or make it shorter")
    return SourceFile(path.absolute(), content)


def defined_in(source: SourceFile) -> type[Measurement[Any]]:
    """Execute a file and return the one protocol that it defines.

    Raises:
        ProtocolError: it fails, or defines no protocol, an unfinished one, or several.
    """
    loader = _Text(source)
    name = f"protocol_{source.sha256}"
    spec = spec_from_loader(name, loader, origin=str(source.path))
    if spec is None:
        raise ProtocolError(f"{source.path}: cannot be loaded: name a Python file")
    sys.modules[name] = module = module_from_spec(spec)  # pydantic looks there for the names of types
    try:
        loader.exec_module(module)
    except (Exception, SystemExit) as error:
        where = place_in(error) or str(source.path)
        said = str(error)
        if isinstance(error, SyntaxError) and error.filename == str(source.path):
            where, said = f"{source.path}, line {error.lineno}", error.msg
        said = " ".join(said.split())
        raise ProtocolError(f"{where}: {type(error).__name__}: {said}: correct it") from error
    found = _protocols_of(module)
    if len(found) != 1:
        told = ", ".join(one.__name__ for one in found) or "none"
        raise ProtocolError(
            f"{source.path}: defines {len(found)} protocols ({told}): write one, a child of Measurement"
        )
    [protocol] = found
    if missing := sorted(getattr(protocol, "__abstractmethods__", ())):
        raise ProtocolError(f"{source.path}: {protocol.__name__} lacks {', '.join(missing)}: write them")
    called = getattr(protocol, "name", None)
    if not isinstance(called, str) or not NAME.fullmatch(called):
        raise ProtocolError(
            f"{source.path}: {protocol.__name__} has no name that a folder can have: write "
            f'name: ClassVar[str] = "my-protocol"'
        )
    protocol.source_file = source
    return protocol


def place_in(error: BaseException) -> str | None:
    """File and line of somebody's own protocol that an error came through last; None where it came through none."""
    place = None
    for frame, line in walk_tb(error.__traceback__):
        if isinstance(loader := frame.f_globals.get("__loader__"), _Text):
            place = f"{loader.file.path}, line {line}"
    return place


def _protocols_of(module: ModuleType) -> list[type[Measurement[Any]]]:
    """Those that it defines, not those that it imports."""
    return [
        one
        for _, one in inspect.getmembers(module, inspect.isclass)
        if issubclass(one, Measurement) and one.__module__ == module.__name__
    ]
