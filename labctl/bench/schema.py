"""JSON Schema of the files that people write: station files, and the protocol files of every installed protocol."""

import json
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, create_model

from instruments.remedies import unwritable
from instruments.sections import InstrumentSection
from labctl.bench.drivers import installed
from labctl.bench.station import USUAL, Station
from labctl.errors import UsageError
from labctl.runs.format.durable import show_file
from protocols.registry import protocol_class, protocol_names

DIALECT = "https://json-schema.org/draft/2020-12/schema"
STATION = "station"

Schema = dict[str, Any]


def names() -> tuple[str, ...]:
    """What there are schemas of: the station, and protocols by name."""
    return (STATION, *protocol_names())


def schema_of(name: str) -> Schema:
    """The schema of station files, or of files of the protocol `name`.

    It says less than the program checks: what it refuses is wrong or has no effect, what it lets pass may be wrong,
    such as a level above its limit. Quantities are text with one of the usual units; a protocol's may be numbers in SI.

    Raises:
        UsageError: there is none.
    """
    if name == STATION:
        found: Schema = _with_units(_tidy(_station().model_json_schema()))
        del found["properties"]["source"]  # which the reader sets
        found["additionalProperties"] = False  # a table that no installed driver is for is refused
        return {"$schema": DIALECT, "title": "Station file"} | found
    if name not in protocol_names():
        raise UsageError(f"schema of {name!r}: there is none: choose one of {', '.join(names())}")
    settings: Schema = _tidy(protocol_class(name).model_json_schema())
    return {
        "$schema": DIALECT,
        "title": f"Protocol file of {name}",
        "$defs": settings.pop("$defs", {}),
        "type": "object",
        "properties": {"protocol": {"const": name}, "settings": settings},
        "required": ["protocol"],
        "additionalProperties": False,
    }


def _with_units(schema: Any) -> Any:
    """A schema in which no number stands where text with a unit may."""
    if isinstance(schema, list):
        return [_with_units(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    found = {key: _with_units(value) for key, value in schema.items()}
    choices = found.get("anyOf", [])
    if any("pattern" in one for one in choices):
        found["anyOf"] = [one for one in choices if one.get("type") != "number"]
    return found


def _station() -> type[BaseModel]:
    """The model of station files whose instruments have one of the installed drivers, told apart by `driver`."""
    sections = {
        role: reduce(or_, (_section(role, name, found.section) for name, found in installed(role).items()))
        for role in (*USUAL, *sorted({found.role for found in installed().values()} - USUAL.keys()))
    }
    fields: dict[str, Any] = {role: (section, Field(default_factory=dict)) for role, section in sections.items()}
    return create_model("Station", __base__=Station, __doc__=Station.__doc__, **fields)


def _section(role: str, name: str, section: type[InstrumentSection]) -> Any:
    """The section of one driver; only of the usual one the name may be left out."""
    about = Field(description=section.model_fields["driver"].description)
    named: dict[str, Any] = {"driver": (Annotated[Literal[name], about], name if USUAL.get(role) == name else ...)}
    return create_model(name, __base__=section, __doc__=section.__doc__, **named)


def write_schemas(folder: Path) -> list[Path]:
    """Write every schema into `folder`, in place of those there; returns the files.

    Raises:
        UsageError: it cannot be written there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return [write_schema(folder / file_name(name), name) for name in names()]
    except OSError as error:
        raise UsageError(unwritable(folder, error, "name another folder")) from None


def file_name(name: str) -> str:
    """What the file with the schema of `name` is called."""
    return f"{name}.schema.json"


def write_schema(path: Path, name: str) -> Path:
    """Write the schema of `name` to `path`, all or nothing, and return that.

    Raises:
        OSError: it cannot be written.
    """
    show_file(path, (json.dumps(schema_of(name), indent=2, ensure_ascii=False) + "\n").encode())
    return path


def _tidy(schema: Any) -> Any:
    """Without what pydantic adds for nobody: titles made of names, and bounds by words that JSON Schema lacks."""
    if isinstance(schema, list):
        return [_tidy(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    generated = {"gt", "ge", "lt", "le", *(("title",) if isinstance(schema.get("title"), str) else ())}
    return {key: _tidy(value) for key, value in schema.items() if key not in generated}
