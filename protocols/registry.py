"""Protocols by name or from a file, with settings from the command line on top."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from instruments.plug_ins import plug_ins
from instruments.remedies import unreadable
from instruments.toml_files import TomlError, describe, one_line, read_toml
from protocols.base import Judgement, Measurement, ProtocolError, SourceFile
from protocols.own_file import SUFFIX, defined_in, read_source

GROUP = "labctl.protocols"


def read_protocol(subject: str, settings: Sequence[str]) -> Measurement[Any]:
    """The protocol that whoever types a command names, with settings.

    subject: a name, a TOML file `protocol = "name"` with a table `[settings]`, or a Python file, which is executed.
    settings: `key=value`; they win over the file.

    Raises:
        ProtocolError: no such protocol, no such setting, or a value that does not fit it.
    """
    origin = "--set"
    values: dict[str, Any] = {}
    name = subject
    if subject.endswith(".toml"):
        name, values = _read_file(Path(subject))
        origin = subject
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise ProtocolError(f"--set {setting}: write it as key=value")
        values[key.strip()] = value.strip()
    found = protocol_class(name) if subject.endswith(".toml") else named_protocol(name)
    return with_settings(found, values, origin=origin)


def protocol_from(name: str, values: Mapping[str, Any], *, origin: str) -> Measurement[Any]:
    """The installed protocol called `name` with settings `values`, which come from `origin`, a file or an option.

    Raises:
        ProtocolError: no such protocol, no such setting, or a value that does not fit it.
    """
    return with_settings(protocol_class(name), values, origin=origin)


def with_settings(protocol: type[Measurement[Any]], values: Mapping[str, Any], *, origin: str) -> Measurement[Any]:
    """A protocol with settings `values`, which come from `origin`, a file or an option.

    Raises:
        ProtocolError: no such setting, or a value that does not fit it.
    """
    unknown = values.keys() - protocol.model_fields.keys()
    if unknown:
        raise ProtocolError(
            f"{origin}: {min(unknown)}: {protocol.name} has no such setting: choose from "
            f"{', '.join(protocol.model_fields)}"
        )
    for key, value in values.items():
        if isinstance(value, str) and not one_line(value):
            raise ProtocolError(f"{origin}: {key} = {value[:40]!r} does not fit on one line: write it as a single word")
    try:
        return protocol.model_validate(values)
    except ValidationError as error:
        raise ProtocolError(f"{origin}: {describe(error)}") from None


def named_protocol(name_or_file: str) -> type[Measurement[Any]]:
    """The protocol that whoever types a command names: an installed one, or a Python file, which is executed.

    Raises:
        ProtocolError: it is not installed, or the file does not define a protocol with a name of its own.
    """
    if not name_or_file.endswith(SUFFIX):
        return protocol_class(name_or_file)
    return protocol_of(read_source(Path(name_or_file)))


def protocol_of(source: SourceFile) -> type[Measurement[Any]]:
    """The protocol that a Python file defines, which is executed.

    Raises:
        ProtocolError: it does not define one, or one that is called as an installed one.
    """
    found = defined_in(source)
    if found.name in protocol_names():
        raise ProtocolError(
            f"{source.path}: name = {found.name!r} is that of an installed protocol: choose another one"
        )
    return found


def protocol_class(name: str) -> type[Measurement[Any]]:
    """The protocol called `name`, without settings.

    Raises:
        ProtocolError: it is not installed, or its package cannot be imported.
    """
    found = plug_ins(GROUP)
    if name not in found:
        raise ProtocolError(f"protocol {name!r} is not installed: choose one of {', '.join(protocol_names())}")
    try:
        protocol: type[Measurement[Any]] = found[name].load()
    except (ImportError, AttributeError) as error:
        raise ProtocolError(f"protocol {name!r} cannot be loaded ({error}): install its package again") from error
    return protocol


def protocol_names() -> tuple[str, ...]:
    """The names of the protocols that are installed, in alphabetical order."""
    return tuple(plug_ins(GROUP))


def judgement_of(name: str) -> Judgement:
    """How runs of the protocol called `name` are judged; of one that cannot be found any more nothing is known."""
    try:
        return protocol_class(name).judgement
    except ProtocolError:
        return Judgement.NONE


def _read_file(path: Path) -> tuple[str, dict[str, Any]]:
    try:
        content = read_toml(path)
    except OSError as error:
        raise ProtocolError(unreadable(path, error, "name a protocol or a protocol file")) from None
    except TomlError as error:
        raise ProtocolError(f"{path}: is not TOML ({error}): correct that line") from None
    name, settings = content.pop("protocol", None), content.pop("settings", {})
    if not isinstance(name, str) or not isinstance(settings, dict) or content:
        raise ProtocolError(f'{path}: needs protocol = "name" and a table [settings], and nothing else')
    return name, settings
