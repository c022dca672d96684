"""A station file to begin with: what was found and answered, every other key with its default and what it is."""

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from pydantic import BaseModel

from labctl.bench.drivers import driver
from labctl.bench.station import USUAL, Station, toml

WRITTEN = {
    "amplitude": (1.0, "V"),
    "timeout": (1.0, "s"),
    "trigger_level": (1.0, "V"),
    "trigger_high": (1.0, "V"),
    "bandwidth": (1e-9, "GHz"),
    "power": (1e3, "mW"),
    "wavelength": (1.0, "nm"),
    "optical_power": (1e3, "mW"),
    "rf_amplitude": (1.0, "V"),
    "detector": (1.0, "V"),
    "amplified_power": (1e3, "mW"),
    "valid": (1 / 86400, "days"),
}
"""How quantities are written: so many of the unit to one of SI, or of the unit that the name carries."""

HEADING = """\
#:schema {schema}
# The bench as labctl drives it: what is where, how it is wired, and what must never be exceeded.
# A line that begins with "# key = " is a default: remove the # and write your own. Quantities have units.
"""

REMARKS: Mapping[str, tuple[str, ...]] = {
    "laser": (
        "The beam is invisible and of class 3B: wear goggles. No run switches it on before you say so,",
        "by armed = true here or by --arm; every way out of a run switches it off.",
    ),
    "limits": ("labctl refuses what exceeds these before it sends anything. Write what your bench endures.",),
    "sim": ('Only for instruments whose address is "simulated".',),
}
"""What is to be known of a table besides its keys."""

Values = Mapping[str, Mapping[str, Any]]


def draft(values: Values, remarks: Mapping[str, Sequence[str]], *, name: str, schema: str) -> str:
    """The text of a station file called `name`.

    values: table -> key -> what it is set to, for every instrument its driver at least; every other key is written as a
    comment with its default. remarks: table -> lines about what was found. schema: where the JSON Schema lies, for
    editors.
    """
    mixed = f"# mixed = false  # {Station.model_fields['mixed'].description}\n"
    parts = [HEADING.format(schema=schema) + f"\nname = {toml(name)}\n{mixed}"]
    for table, field in Station.model_fields.items():
        section: Any = driver(table, values[table]["driver"]).section if table in USUAL else field.annotation
        if isinstance(section, type) and issubclass(section, BaseModel):
            parts.append("\n".join(_table(table, section, values.get(table, {}), remarks.get(table, ()))) + "\n")
    return "\n".join(parts)


def _table(table: str, section: type[BaseModel], values: Mapping[str, Any], found: Sequence[str]) -> list[str]:
    title = (section.__doc__ or "").strip().partition("\n")[0]
    lines = [f"[{table}]", *(f"# {line}" for line in (title, *REMARKS.get(table, ()), *found))]
    for key, field in section.model_fields.items():
        about = f"  # {field.description}" if field.description else ""
        if key in values:
            lines.append(f"{key} = {toml(values[key])}{about}")
        elif field.default is not None:
            lines.append(f"# {key} = {toml(_written(key, field.default))}{about}")
        else:
            lines.append(f'# {key} = ""{about}')
    return lines


def _written(key: str, value: Any) -> Any:
    if isinstance(value, PurePath):
        return value.as_posix()
    factor, unit = WRITTEN.get(key, (1.0, ""))
    return f"{value * factor:g} {unit}" if unit else value
