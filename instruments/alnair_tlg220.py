"""Alnair Labs TLG-220 tunable laser, driven from a command table that the operator can correct."""

import contextlib
import math
import re
import time
from typing import Annotated

from pydantic import Field

from instruments.command_table import SWITCHED, UNKNOWN, Command
from instruments.driver import Driver
from instruments.errors import InstrumentError, LightLost, NotConfigured
from instruments.interfaces import TunableLaser
from instruments.laser_table import DEFAULT_TABLE, LaserTable
from instruments.readback import confirm, confirm_off
from instruments.sections import File, LaserSection
from instruments.transcripts import Transcript
from instruments.units import decibels_milliwatt, watts
from instruments.values import Change, Examination, Identity
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
    open=lambda section, opening: Tlg220(
        opening.address, _table(section).ready(attended=opening.attended), opening.transcript
    ),
    identity=re.compile(r"Alnair.*TLG-?2\d0", re.IGNORECASE),
    sent_anew=("wavelength_nm", "power_dbm", "emitting"),
    ranges=lambda section: _table(section).ranges(),
)

WAVELENGTH_TOLERANCE_NM = 0.01
POWER_TOLERANCE_DB = 0.2
WANDERING = {"get_wavelength": 0.002, "get_power": 0.05}
"""How far the answers of a laser that nobody sets may lie from those at first, nm and dBm."""
LONGEST_ANSWER = 300
"""Characters of an answer that a table's expression is held against."""


class Tlg220(TunableLaser):
    """A TLG-220 behind a verified command table."""

    switches_itself = True

    def __init__(self, resource: str, table: LaserTable, transcript: Transcript) -> None:
        """Drive the laser at the VISA address `resource` with the commands of `table`."""
        self._table = table
        self._settled: dict[str, float] = {}
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
        self._settled["get_wavelength"] = settled = confirm(
            "laser: wavelength",
            wavelength_nm,
            self._number("get_wavelength"),
            WAVELENGTH_TOLERANCE_NM,
            unit="nm",
            remedy="check its tuning range",
        )
        return settled

    def set_power(self, power_w: float) -> float:
        """Set the output power and compare with the read-back (tolerance 0.2 dB)."""
        power_dbm = decibels_milliwatt(power_w)
        self._set("power", power_dbm)
        self._settled["get_power"] = settled_dbm = confirm(
            "laser: power",
            power_dbm,
            self._number("get_power"),
            POWER_TOLERANCE_DB,
            unit="dBm",
            remedy="check its power range",
        )
        return watts(settled_dbm)

    def power(self) -> float:
        """What `get_power` answers."""
        return watts(self._number("get_power"))

    def emit(self) -> None:
        """Emission on, settled."""
        with self._link.checked():
            self._link.write(self._command("output_on").write)
        self._settle()

    def require_emission(self) -> None:
        """Read-back of the emission; where there is none, the error queue may say why."""
        if self._number("get_output") != 1:
            reasons = "; ".join(self._link.errors()[:1]) or "it does not say why"
            raise LightLost(f"laser: the light went out by itself ({reasons}): check interlock and front panel")

    def darken(self) -> None:
        """Emission off, by its own answer: what the error queue says, of an open interlock say, does not count."""
        self._link.write(self._command("output_off").write)
        errors = self._link.errors()
        confirm_off("laser: still emits after output_off", self._number("get_output"), errors, "use its key switch")

    def changes(self) -> tuple[Change, ...]:
        """Wavelength and power, as far as they are not what they wander by."""
        found = []
        for question, then in self._settled.items():
            now = self._number(question)
            if abs(now - then) > WANDERING[question]:
                found.append(Change(question.removeprefix("get_"), f"{then:g}", f"{now:g}"))
        return tuple(found)

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
        """Emission off, sent even to a laser that no longer answers."""
        self.darken()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    # As in `TableLink`, which is not used here: every shot asks the laser, and is to pass through few files.

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
            if math.isfinite(number := float(SWITCHED.get(str(text).upper(), text))):
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


def _table(section: Tlg220Section) -> LaserTable:
    return LaserTable.read(section.commands or DEFAULT_TABLE)
