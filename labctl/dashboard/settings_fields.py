"""The fields of a form, from the JSON Schema of a protocol's settings: whatever protocol is installed has one. Pure."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

PREFIXES = {1e9: "G", 1e6: "M", 1e3: "k", 1.0: "", 1e-3: "m", 1e-6: "µ", 1e-9: "n", 1e-12: "p"}
WHOLE = ("nm",)
"""Units that have their prefix already."""
_REFUSED = re.compile(r"--set: (?P<name>\w+) = '.*?': (?P<why>.*)", re.DOTALL)


@dataclass(frozen=True)
class Setting:
    """A setting: its name, what it usually is as text (empty: nothing), what it may be, and within which bounds."""

    name: str
    usual: str = ""
    choices: tuple[str, ...] = ()
    unit: str = ""
    bounds: str = ""

    @property
    def hint(self) -> str:
        """What stands below its field."""
        return ", ".join(filter(None, (self.bounds, f"in {self.unit}" if self.unit else "")))


def settings_of(schema: Mapping[str, Any]) -> list[Setting]:
    """The settings of a protocol, from the schema of its files, in their order."""
    return [
        Setting(
            name,
            usual=text_of(found.get("default"), unit := _unit(found)),
            choices=_choices(found),
            unit=unit,
            bounds=_bounds(found),
        )
        for name, found in schema["properties"]["settings"]["properties"].items()
    ]


def about(schema: Mapping[str, Any]) -> str:
    """What the protocol does, in its own words; one paragraph a line."""
    words = str(schema["properties"]["settings"].get("description", ""))
    return "\n".join(" ".join(paragraph.split()) for paragraph in words.split("\n\n"))


def text_of(value: object, unit: str = "") -> str:
    """A value as it is written behind `--set`; a number in SI units with its unit.

    Example:
        >>> from labctl.dashboard.settings_fields import text_of
        >>> text_of(2e-9, "s"), text_of([2, 3]), text_of([1550.0], "nm"), text_of(None)
        ('2 ns', '2,3', '1550 nm', '')
    """
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return ",".join(text_of(one, unit) for one in value)
    if not unit or not isinstance(value, int | float):
        return str(value)
    if unit in WHOLE or not value:
        return f"{value:g} {unit}"
    size = next((size for size in PREFIXES if abs(value) >= size * (1 - 1e-9)), 1e-12)
    return f"{value / size:.6g} {PREFIXES[size]}{unit}"


def refused(message: str) -> tuple[str, str]:
    """Which setting a message of `labctl run` is about, empty for none of them alone, and why it is refused."""
    match = _REFUSED.fullmatch(message)
    return (match["name"], match["why"]) if match else ("", message)


def _parts(schema: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """A schema, its alternatives, and what its lists hold."""
    yield schema
    for part in [*schema.get("anyOf", ()), *([schema["items"]] if isinstance(schema.get("items"), dict) else [])]:
        yield from _parts(part)


def _unit(schema: Mapping[str, Any]) -> str:
    return next((str(part["unit"]) for part in _parts(schema) if "unit" in part), "")


def _choices(schema: Mapping[str, Any]) -> tuple[str, ...]:
    if schema.get("type") == "boolean":
        return ("false", "true")
    return tuple(map(str, schema.get("enum", ())))


def _bounds(schema: Mapping[str, Any]) -> str:
    words = {"minimum": "from {}", "exclusiveMinimum": "above {}", "maximum": "to {}", "exclusiveMaximum": "below {}"}
    numbers = {key: part[key] for part in _parts(schema) for key in words if key in part}
    said = [words[key].format(numbers[key]) for key in words if key in numbers]
    return " ".join([*said, *(f"or {part['const']}" for part in _parts(schema) if "const" in part)])
