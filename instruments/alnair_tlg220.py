"""Alnair Labs TLG-220 tunable laser, driven from a command table that the operator can correct.

No public command set exists for this laser, so the commands are data: a TOML file beside this module, or one the
station names. What is still `<unknown>` there raises a named error, and an unverified table never emits unattended.
"""

import contextlib
import math
import re
import time
from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from instruments.driver import Driver, LaserRanges, Opening
from instruments.errors import InstrumentError, NotConfigured
from instruments.interfaces import TunableLaser
from instruments.readback import confirm
from instruments.sections import File, LaserSection
from instruments.toml_files import TomlError, one_line, read_toml
from instruments.transcripts import Transcript
from instruments.values import Examination, Identity, Range
from instruments.visa import MAX_ERRORS_READ, VisaLink


class Tlg220Section(LaserSection):
    """The light source. Its command set is not public: try each command of a table, and name its file by `commands`.

    "simulated" names the table of the simulated laser. `armed` allows light.
    """

    commands: Annotated[
        File | None, Field(description="File with the laser's commands; without it the driver's own table.")
    ] = None


DRIVER = Driver(
    section=Tlg220Section,
    open=lambda section, opening: _opened(section, opening),
    identity=re.compile(r"Alnair.*TLG-?2\d0", re.IGNORECASE),
    sent_anew=("wavelength_nm", "power_dbm", "emitting"),
    ranges=lambda section: _table(section).ranges(),
)

UNKNOWN = "<unknown>"
DEFAULT_TABLE = Path(__file__).with_suffix(".toml")
COMMANDS = {
    name: tuple(re.compile(entry.get("reply", "")).groupindex)
    for name, entry in read_toml(DEFAULT_TABLE)["commands"].items()
}
"""The commands that a table must have, and the named groups that the expression of each reply must have."""
WAVELENGTH_TOLERANCE_NM = 0.01
POWER_TOLERANCE_DB = 0.2
LONGEST_ANSWER = 300
"""Characters of an answer that a table's expression is held against."""

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
    step: float | None = None
    poll_s: float = Field(default=0.1, ge=0, le=60)
    timeout_s: float = Field(default=30.0, gt=0, le=3600)


class TableTransport(BaseModel):
    """How messages end on this laser, and how long a reply may take."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    write_eol: str = Field(default="\n", pattern=r"^[\r\n]{1,2}$")
    read_eol: str = Field(default="\n", pattern=r"^[\r\n]{1,2}$")
    timeout_s: float = Field(default=2.0, gt=0, le=3600)


class CommandTable(BaseModel):
    """The laser's commands as its operator knows them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: str = Field(max_length=200)
    verified: bool
    transport: TableTransport = TableTransport()
    commands: dict[str, Command]
    source: str = ""

    @model_validator(mode="after")
    def _replies_give_what_is_read(self) -> Self:
        for name, command in self.commands.items():
            wanted = COMMANDS.get(name, ())
            if command.write != UNKNOWN and not set(wanted) <= set(re.compile(command.reply or "").groupindex):
                groups = " and ".join(f"(?P<{group}>...)" for group in wanted)
                raise ValueError(f"commands.{name}.reply lacks {groups}")
        return self

    @classmethod
    def read(cls, path: Path) -> "CommandTable":
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
            raise NotConfigured(f"{path}: {message}: correct the laser's command table") from None
        except (OSError, TomlError) as error:
            raise NotConfigured(f"{path}: {error}: the laser's command table cannot be read") from None

    def range(self, quantity: str) -> Range:
        """What `quantity`, "wavelength" or "power", can be set to, in the unit of the table."""
        command = self.commands.get(f"set_{quantity}")
        return Range(-math.inf, math.inf, "") if command is None else Range(command.min, command.max, command.unit)

    def ranges(self) -> LaserRanges:
        """What wavelength and power can be set to."""
        return LaserRanges(self.range("wavelength"), self.range("power"), self.source, key="commands")

    def require_complete(self) -> None:
        """Check that every command is there.

        Raises:
            NotConfigured: a command is missing or `<unknown>`.
        """
        for name in COMMANDS:
            if name not in self.commands or self.commands[name].write == UNKNOWN:
                raise NotConfigured(
                    f"{self.source}: commands.{name}.write = {UNKNOWN!r}: enter the command from the laser's manual, "
                    f"or use the driver 'manual-laser'"
                )

    def require_verified(self) -> None:
        """Check that the laser may be switched on with nobody beside it.

        Raises:
            NotConfigured: `verified` is not true.
        """
        if not self.verified:
            raise NotConfigured(
                f"{self.source}: verified = false: try every command on the bench, then set verified = true; "
                f"until then the laser is not switched on unattended"
            )


class Tlg220(TunableLaser):
    """A TLG-220 behind a verified command table."""

    switches_itself = True

    def __init__(self, resource: str, table: CommandTable, transcript: Transcript) -> None:
        """Drive the laser at the VISA address `resource` with the commands of `table`."""
        self._table = table
        self._link = VisaLink(
            resource,
            name="laser",
            timeout_s=table.transport.timeout_s,
            transcript=transcript,
            error_queue=self._read_errors,
            write_eol=table.transport.write_eol,
            read_eol=table.transport.read_eol,
        )

    def identify(self) -> Identity:
        """What the `identify` command answers."""
        return Identity.parse(self._ask("identify")["text"])

    def examine(self) -> Examination:
        """The error queue, and the limits of the table."""
        limits = {quantity: self._table.range(quantity) for quantity in ("wavelength", "power")}
        return Examination(errors=tuple(self._link.errors()), limits=limits)

    def self_test(self) -> None:
        """Ask for the error queue: the table knows no other test that needs no light."""
        with self._link.checked():
            self._number("get_output")

    def tune(self, wavelength_nm: float) -> float:
        """Set the wavelength, wait until settled, and compare with the read-back (tolerance 10 pm)."""
        self._set("wavelength", wavelength_nm)
        self._settle()
        return confirm(
            "laser: wavelength",
            wavelength_nm,
            self._number("get_wavelength"),
            WAVELENGTH_TOLERANCE_NM,
            unit="nm",
            remedy="check its tuning range",
        )

    def set_power(self, power_w: float) -> float:
        """Set the output power and compare with the read-back (tolerance 0.2 dB)."""
        power_dbm = 10 * math.log10(power_w / 1e-3) if power_w > 0 else -math.inf
        self._set("power", power_dbm)
        settled_dbm = confirm(
            "laser: power",
            power_dbm,
            self._number("get_power"),
            POWER_TOLERANCE_DB,
            unit="dBm",
            remedy="check its power range",
        )
        return _watts(settled_dbm)

    def power(self) -> float:
        """What `get_power` answers."""
        return _watts(self._number("get_power"))

    def emit(self) -> None:
        """Emission on, settled."""
        with self._link.checked():
            self._link.write(self._command("output_on").write)
        self._settle()

    def require_emission(self) -> None:
        """Read-back of the emission; where there is none, the error queue may tell why."""
        if self._number("get_output") != 1:
            reasons = "; ".join(self._link.errors()[:1]) or "it does not say why"
            raise InstrumentError(f"laser: the light went out by itself ({reasons}): check interlock and front panel")

    def darken(self) -> None:
        """Emission off, confirmed by read-back."""
        with self._link.checked():
            self._link.write(self._command("output_off").write)
        if self._number("get_output") != 0:
            raise InstrumentError("laser: still emits after output_off: use its key switch")

    def settings(self) -> dict[str, str | float]:
        """Wavelength, power and whether it emits."""
        return {
            "model": self._table.model,
            "table_verified": str(self._table.verified).lower(),
            "wavelength_nm": self._number("get_wavelength"),
            "power_dbm": self._number("get_power"),
            "emitting": self._number("get_output"),
        }

    def make_safe(self) -> None:
        """Emission off, told to a laser that no longer answers as well; earlier errors are not held against it."""
        self._link.write(self._command("output_off").write)
        self._link.errors()
        self.darken()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _command(self, name: str) -> Command:
        command = self._table.commands.get(name)
        if command is None or command.write == UNKNOWN:
            raise NotConfigured(f"{self._table.source}: commands.{name} is not configured: enter it from the manual")
        return command

    def _ask(self, name: str) -> dict[str, str]:
        command = self._command(name)
        answer = self._link.query(command.write)
        match = re.fullmatch(command.reply or "(?P<text>.*)", answer) if len(answer) <= LONGEST_ANSWER else None
        if match is None:
            raise InstrumentError(
                f"laser: {command.write!r} was answered {answer[:LONGEST_ANSWER]!r}, expected {command.reply!r}: "
                f"correct {self._table.source}"
            )
        return match.groupdict()

    def _number(self, name: str) -> float:
        text = self._ask(name)["value"]
        with contextlib.suppress(TypeError, ValueError):  # a group that is not part of every answer; or no number
            if math.isfinite(number := float(text)):
                return number
        raise InstrumentError(
            f"laser: {self._command(name).write!r} was answered {text!r}, not a number: correct {self._table.source}"
        )

    def _set(self, quantity: str, value: float) -> None:
        command = self._command(f"set_{quantity}")
        self._table.range(quantity).check(f"laser {quantity}", value)
        with self._link.checked():
            self._link.write(command.write.format(value=value))

    def _settle(self) -> None:
        command = self._command("is_settled")
        deadline = time.monotonic() + command.timeout_s
        while self._number("is_settled") != 1:
            if time.monotonic() > deadline:
                raise InstrumentError(f"laser: not settled after {command.timeout_s:g} s: check its front panel")
            time.sleep(command.poll_s)

    def _read_errors(self, _link: VisaLink) -> list[str]:
        errors: list[str] = []
        for _ in range(MAX_ERRORS_READ):
            reply = self._ask("error")
            if re.fullmatch(r"[-+]?0+", reply["code"] or ""):
                break
            errors.append(f"{reply['code']} {reply['text']}")
        return errors


def _table(section: Tlg220Section) -> CommandTable:
    return CommandTable.read(section.commands or DEFAULT_TABLE)


def _opened(section: Tlg220Section, opening: Opening) -> Tlg220:
    """The laser with its table, which must be complete, and verified where nobody is at the bench."""
    table = _table(section)
    table.require_complete()
    if not opening.attended:
        table.require_verified()
    return Tlg220(opening.address, table, opening.transcript)


def _watts(dbm: float) -> float:
    try:
        return float(1e-3 * 10 ** (dbm / 10))
    except OverflowError:
        return math.inf  # above every limit
