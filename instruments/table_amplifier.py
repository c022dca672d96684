"""An optical amplifier whose commands are a table: no public command set is common to them."""

from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field

from instruments.command_table import CommandTable
from instruments.driver import Driver
from instruments.errors import InstrumentError, LightLost, NotConfigured
from instruments.interfaces import Amplifier
from instruments.readback import confirm_off
from instruments.sections import SIMULATED, AmplifierSection, File
from instruments.table_link import TableLink
from instruments.units import decibels_milliwatt, watts
from instruments.values import Change, Examination, Identity

SIMULATED_TABLE = Path(__file__).with_name("table_amplifier.toml")
"""The commands of the simulated amplifier, to rehearse with and to begin a table of one's own from."""
POWER_TOLERANCE_DB = 0.2


class TableAmplifierSection(AmplifierSection):
    """The optical amplifier between modulator and fibre, driven by a table of commands."""

    commands: Annotated[File | None, Field(description='File with its commands, or "simulated".')] = None


class AmplifierTable(CommandTable):
    """The amplifier's commands as its operator knows them."""

    INSTRUMENT = "amplifier"
    NEEDED: ClassVar = {
        "identify": ("text",),
        "set_power": (),
        "get_power": ("value",),
        "output_power": ("value",),
        "output_on": (),
        "output_off": (),
        "get_output": ("value",),
        "error": ("code", "text"),
    }

    @classmethod
    def named(cls, file: Path | None) -> "AmplifierTable":
        """The table that a section names.

        Raises:
            NotConfigured: it names none, or one that cannot be read.
        """
        if file is None:
            raise NotConfigured("amplifier.commands is missing: name the file with the amplifier's commands")
        return cls.read(SIMULATED_TABLE if str(file) == SIMULATED else file)


DRIVER = Driver(
    section=TableAmplifierSection,
    open=lambda section, opening: TableAmplifier(
        TableLink(
            opening.address,
            AmplifierTable.named(section.commands).ready(attended=opening.attended),
            name="amplifier",
            transcript=opening.transcript,
        )
    ),
    sent_anew=("power_dbm", "on"),
)


class TableAmplifier(Amplifier):
    """An amplifier behind a verified command table; the table's powers are in dBm."""

    def __init__(self, link: TableLink) -> None:
        """Drive the amplifier behind `link`."""
        self._link = link
        self._set_dbm: float | None = None

    def identify(self) -> Identity:
        """What the `identify` command answers."""
        return Identity.parse(self._link.text("identify"))

    def examine(self) -> Examination:
        """The error queue, and the limits of the table."""
        return Examination(errors=tuple(self._link.errors()), limits={"power": self._link.table.range("power")})

    def self_test(self) -> None:
        """Ask whether it is on; the table knows no other test that needs no light."""
        with self._link.checked():
            self._link.number("get_output")

    def set_power(self, power_w: float) -> float:
        """Set the output power and compare with the read-back (tolerance 0.2 dB)."""
        power_dbm = decibels_milliwatt(power_w)
        self._set_dbm = self._link.set("power", power_dbm, POWER_TOLERANCE_DB)
        return watts(self._set_dbm)

    def power(self) -> float:
        """What `output_power` answers."""
        return watts(self._link.number("output_power"))

    def switch_on(self) -> None:
        """On, confirmed by read-back."""
        with self._link.checked():
            self._link.send("output_on")
        if self._link.number("get_output") != 1:
            raise InstrumentError("amplifier: is off after output_on: check its interlock and front panel")

    def require_on(self) -> None:
        """Read-back of the pump."""
        if self._link.number("get_output") != 1:
            raise LightLost("amplifier: is off and was on: check its interlock and front panel")

    def switch_off(self) -> None:
        """Off, by its own answer, whatever its error queue says."""
        self._link.send("output_off")
        errors, on = self._link.errors(), self._link.number("get_output")
        confirm_off("amplifier: still on after output_off", on, errors, "switch it off at its front panel")

    def changes(self) -> tuple[Change, ...]:
        """The output power that was set."""
        if self._set_dbm is None or (now := self._link.number("get_power")) == self._set_dbm:
            return ()
        return (Change("power", f"{self._set_dbm:g}", f"{now:g}"),)

    def settings(self) -> dict[str, str | float]:
        """Output power as set, and whether it is on."""
        return {
            "model": self._link.table.model,
            "table_verified": str(self._link.table.verified).lower(),
            "power_dbm": self._link.number("get_power"),
            "on": self._link.number("get_output"),
        }

    def make_safe(self) -> None:
        """Off, sent even to an amplifier that no longer answers."""
        self.switch_off()

    def close(self) -> None:
        """Close the link."""
        self._link.close()
