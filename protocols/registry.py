"""Protocols by name or from a TOML file, with settings from the command line on top."""

from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from instruments.remedies import unreadable
from instruments.toml_files import TomlError, describe, one_line, read_toml
from protocols.base import Judgement, Measurement, ProtocolError

GROUP = "labctl.protocols"


def read_protocol(name_or_file: str, settings: Sequence[str]) -> Measurement[Any]:
    """The protocol called by name, or described by a file `protocol = "name"` with a table `[settings]`.

    `settings` are `key=value` and win over the file.

    Raises:
        ProtocolError: no such protocol, no such setting, or a value that does not fit it.
    """
    name, origin = name_or_file, "--set"
    values: dict[str, Any] = {}
    if name_or_file.endswith(".toml"):
        name, values = _read_file(Path(name_or_file))
        origin = name_or_file
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise ProtocolError(f"--set {setting}: write it as key=value")
        values[key.strip()] = value.strip()
    return protocol_from(name, values, origin=origin)


def protocol_from(name: str, values: Mapping[str, Any], *, origin: str) -> Measurement[Any]:
    """The protocol called `name` with settings `values`, which come from `origin`, a file or an option.

    Raises:
        ProtocolError: no such protocol, no such setting, or a value that does not fit it.
    """
    protocol = protocol_class(name)
    unknown = values.keys() - protocol.model_fields.keys()
    if unknown:
        raise ProtocolError(
            f"{origin}: {min(unknown)}: {name} has no such setting: choose from {', '.join(protocol.model_fields)}"
        )
    for key, value in values.items():
        if isinstance(value, str) and not one_line(value):
            raise ProtocolError(f"{origin}: {key} = {value[:40]!r} does not fit on one line: write it as a single word")
    try:
        return protocol.model_validate(values)
    except ValidationError as error:
        raise ProtocolError(f"{origin}: {describe(error)}") from None


def protocol_class(name: str) -> type[Measurement[Any]]:
    """The protocol called `name`, without settings.

    Raises:
        ProtocolError: it is not installed, or its package cannot be imported.
    """
    found = {point.name: point for point in entry_points(group=GROUP)}
    if name not in found:
        raise ProtocolError(f"protocol {name!r} is not installed: choose one of {', '.join(protocol_names())}")
    try:
        protocol: type[Measurement[Any]] = found[name].load()
    except (ImportError, AttributeError) as error:
        raise ProtocolError(f"protocol {name!r} cannot be loaded ({error}): install its package again") from error
    return protocol


def protocol_names() -> tuple[str, ...]:
    """The names of the protocols that are installed, in alphabetical order."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


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
