"""Command tables: TOML files that an operator can correct, for instruments without a public command set.

What is still `<unknown>` in one raises a named error, and a table that nobody has verified never emits unattended.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from instruments.errors import NotConfigured
from instruments.toml_files import TomlError, one_line, read_toml
from instruments.values import Range

UNKNOWN = "<unknown>"
SWITCHED = {"ON": "1", "OFF": "0"}
"""Words that some answer where a number is read."""
UNITS = {"wavelength": "nm", "power": "dBm", "attenuation": "dB"}
"""Drivers send and read these quantities as such numbers."""
_NUMBER_PLACE = re.compile(r"\{value(:[-+]?[0-9]{0,2}(\.[0-9]{1,2})?[efgEFG]?)?\}")
_ESCAPED = re.compile(r"\\.|\[\^?\]?(?:\\.|[^\]\\])*\]")
_OPEN_REPEATS, _CHOICES = 4, 6


def _one_command(text: str) -> str:
    """A text to send that is one command, with at most one number in it."""
    bare = _NUMBER_PLACE.sub("", text, count=1)
    if not text.isascii() or not one_line(text) or set(bare) & set(";{}"):
        raise ValueError(
            "is not one command: write it without line ends and semicolons, and a number as {value} or {value:.3f}"
        )
    return text


def _quick_expression(text: str) -> str:
    """A regular expression whose time no answer can make endless: no repeated group, few repeats and choices."""
    try:
        re.compile(text)
    except (re.error, OverflowError, RecursionError) as error:
        raise ValueError(f"is not a regular expression ({error})") from None
    bare = _ESCAPED.sub("x", text).replace("(?", "(")
    repeats, choices = len(re.findall(r"[*+{]", bare)), len(re.findall(r"[?|]", bare))
    if re.search(r"\)[*+{]", bare) or repeats > _OPEN_REPEATS or choices > _CHOICES:
        raise ValueError(
            f"could take for ever: repeat no group, and use at most {_OPEN_REPEATS} of * + {{}} and {_CHOICES} of ? |"
        )
    return text


class Command(BaseModel):
    """One line of the table."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    write: Annotated[str, Field(max_length=200), AfterValidator(_one_command)]
    reply: Annotated[str, Field(max_length=200), AfterValidator(_quick_expression)] | None = None
    unit: str = Field(default="", max_length=20)
    min: float = -math.inf
    max: float = math.inf
    step: float | None = None  # the simulated laser rounds to it; a driver compares what it reads back instead
    poll_s: float = Field(default=0.1, ge=0, le=60)
    timeout_s: float = Field(default=30.0, gt=0, le=3600)


class TableTransport(BaseModel):
    """How messages end on this instrument, and how long a reply may take."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    write_eol: str = Field(default="\n", pattern=r"^[\r\n]{1,2}$")
    read_eol: str = Field(default="\n", pattern=r"^[\r\n]{1,2}$")
    timeout_s: float = Field(default=2.0, gt=0, le=3600)


class CommandTable(BaseModel):
    """An instrument's commands as its operator knows them; a kind of instrument says which these are.

    Attributes:
        INSTRUMENT: What it is, for messages.
        NEEDED: The commands that there must be, and the named groups that the expression of each reply must have.
        SPARED: Those that may be left out, all of them together.
        OTHERWISE: What can be done besides entering a command that is unknown.
    """

    INSTRUMENT: ClassVar[str]
    NEEDED: ClassVar[Mapping[str, tuple[str, ...]]]
    SPARED: ClassVar[tuple[str, ...]] = ()
    OTHERWISE: ClassVar[str] = ""

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: str = Field(max_length=200)
    verified: bool
    transport: TableTransport = TableTransport()
    commands: dict[str, Command]
    source: str = ""

    @model_validator(mode="after")
    def _replies_give_what_is_read(self) -> Self:
        for name, command in self.commands.items():
            wanted = self.NEEDED.get(name, ())
            if command.write != UNKNOWN and not set(wanted) <= set(re.compile(command.reply or "").groupindex):
                groups = " and ".join(f"(?P<{group}>...)" for group in wanted)
                raise ValueError(f"commands.{name}.reply lacks {groups}")
        return self

    @model_validator(mode="after")
    def _numbers_are_what_is_sent(self) -> Self:
        for name, command in self.commands.items():
            unit = UNITS.get(name.rpartition("_")[2], command.unit)
            if command.unit not in ("", unit):
                raise ValueError(f"commands.{name}.unit = {command.unit!r}, but the number is sent and read in {unit}")
        return self

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a table.

        Raises:
            NotConfigured: the file is missing or is not such a table.
        """
        try:
            return cls.model_validate(read_toml(path) | {"source": str(path)})
        except ValidationError as error:
            first = error.errors()[0]
            where = "".join(f"{part}." for part in first["loc"]).removesuffix(".")[:100]
            message = ": ".join(filter(None, (where, first["msg"].removeprefix("Value error, ")[:300])))
            raise NotConfigured(f"{path}: {message}: correct the {cls.INSTRUMENT}'s command table") from None
        except (OSError, TomlError) as error:
            raise NotConfigured(f"{path}: {error}: the {cls.INSTRUMENT}'s command table cannot be read") from None

    def range(self, quantity: str) -> Range:
        """What `quantity`, "wavelength" or "power", can be set to, in the unit of the table."""
        command = self.commands.get(f"set_{quantity}")
        return Range(-math.inf, math.inf, "") if command is None else Range(command.min, command.max, command.unit)

    def ready(self, *, attended: bool) -> Self:
        """The table itself if its instrument can be driven: complete, and verified unless somebody is at the bench.

        Raises:
            NotConfigured: it is not.
        """
        self.require_complete()
        if not attended:
            self.require_verified()
        return self

    def require_complete(self) -> None:
        """Check that every command is there.

        Raises:
            NotConfigured: a command is missing or `<unknown>`.
        """
        spared = self.SPARED if self.commands.keys().isdisjoint(self.SPARED) else ()
        for name in self.NEEDED:
            if name in spared:
                continue
            if name not in self.commands or self.commands[name].write == UNKNOWN:
                raise NotConfigured(
                    f"{self.source}: commands.{name}.write = {UNKNOWN!r}: enter the command from the "
                    f"{self.INSTRUMENT}'s manual{self.OTHERWISE}"
                )

    def require_verified(self) -> None:
        """Check that the instrument may be switched on with nobody at it.

        Raises:
            NotConfigured: `verified` is not true.
        """
        if not self.verified:
            raise NotConfigured(
                f"{self.source}: verified = false: try every command on the bench, then set verified = true; "
                f"until then the {self.INSTRUMENT} is not switched on unattended"
            )
