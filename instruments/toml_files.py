"""TOML files that may be anybody's: bounded before they are parsed, and taken as data or refused in one line."""

import tomllib
from collections.abc import Iterable
from difflib import get_close_matches
from errno import EINVAL
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import ValidationError

LARGEST_FILE = 64 * 1024
"""Bytes: ten times what any of these files needs."""
LONGEST_LINE = 2000
"""Bytes: the parser's time grows with the square of a dotted key's length."""
DEEPEST = 20
"""Lists and tables inside each other."""
LARGEST_NUMBER = 2**63
"""Whole numbers of TOML have 64 bits; larger ones are refused, because other programs cannot read them either."""
LONGEST_PART = 300
"""Characters of a key, a value or a reason in a message."""

BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
"""Kinds of faults whose message ends with a number."""


class TomlError(ValueError):
    """The text is not TOML, or not such as these files hold: a few words that say what is wrong with it."""


def read_toml(path: Path) -> dict[str, Any]:
    """What a TOML file says.

    Its keys are printable and fit on one line; texts may hold anything, and it is for who takes them to ask `one_line`.

    Raises:
        OSError: it cannot be read, or is no regular file.
        TomlError: it is not TOML, or larger than such a file can be.
    """
    mode = path.stat().st_mode
    if not (S_ISREG(mode) or S_ISDIR(mode)):  # a pipe is empty for whoever reads it again, and a FIFO may have no end
        raise OSError(EINVAL, "it is no regular file", str(path))
    with path.open("rb") as file:
        content = file.read(LARGEST_FILE + 1)
    if len(content) > LARGEST_FILE:
        raise TomlError(f"it is larger than {LARGEST_FILE} bytes")
    if max(map(len, content.splitlines()), default=0) > LONGEST_LINE:
        raise TomlError(f"it has a line of more than {LONGEST_LINE} bytes")
    try:
        found = tomllib.loads(content.decode("utf-8-sig"))
    except RecursionError:
        raise TomlError("its lists or tables are too deep") from None
    except ValueError as error:  # of the parser, of the text's encoding, of a number with thousands of digits
        raise TomlError(str(error)) from None
    _check(found)
    return found


def one_line(text: str) -> bool:
    """Whether a text can be printed as it is: no line ends, no other control characters."""
    return text.isprintable()


def _check(value: object, depth: int = 0) -> None:
    if depth > DEEPEST:
        raise TomlError("its lists or tables are too deep")
    match value:
        case dict():
            for key, entry in value.items():
                if not one_line(key):
                    raise TomlError(f"the key {key[:40]!r} does not fit on one line")
                _check(entry, depth + 1)
        case list():
            for entry in value:
                _check(entry, depth + 1)
        case int() if not -LARGEST_NUMBER <= value < LARGEST_NUMBER:
            raise TomlError("it holds a whole number of more than 64 bits")


def describe(error: "ValidationError", keys: Iterable[str] = ()) -> str:
    """The first fault of a validation in one line: key, value, what is wrong; each cut to what a line can hold.

    keys: those that there are: the one most like an unknown one is named.
    """
    fault = error.errors(include_url=False)[0]
    key = _cut(".".join(str(part) for part in fault["loc"]))
    if fault["type"] == "missing":
        return f"{key} is missing: write it"
    value = _cut(repr(fault["input"]))
    if fault["type"] == "extra_forbidden":
        meant = get_close_matches(str(fault["loc"][-1]), keys, 1)
        hint = f"did you mean {meant[0]}?" if meant else "check its spelling against the reference of settings"
        return f"{key} = {value}: unknown key: {hint}"
    message = _cut(fault["msg"].removeprefix("Value error, "))
    if fault["type"] in BOUNDS and isinstance(fault["input"], str):
        from instruments.units import any_quantity  # with pydantic, which takes long to load

        if (known := any_quantity(fault["input"])) is not None:
            message = f"{message} {known[1]}"
    return f"{key} = {value}: {message}" if key else message


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST_PART else f"{text[:LONGEST_PART]}..."
