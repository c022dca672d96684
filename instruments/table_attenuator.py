"""A variable optical attenuator whose commands are a table: no public command set is common to them."""

import math
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field

from instruments.command_table import CommandTable
from instruments.driver import Driver
from instruments.errors import InstrumentError, LightLost, NotConfigured
from instruments.interfaces import Attenuator
from instruments.readback import confirm_off
from instruments.sections import SIMULATED, AttenuatorSection, File
from instruments.table_link import TableLink
from instruments.values import Change, Examination, Identity

SIMULATED_TABLE = Path(__file__).with_name("table_attenuator.toml")
"""The commands of the simulated attenuator, to rehearse with and to begin a table of one's own from."""
TOLERANCE_DB = 0.1


class TableAttenuatorSection(AttenuatorSection):
    """The variable attenuator behind the amplifier and before the fibre, driven by a table of commands."""

    commands: Annotated[File | None, Field(description='File with its commands, or "simulated".')] = None


class AttenuatorTable(CommandTable):
    """The attenuator's commands as its operator knows them."""

    INSTRUMENT = "attenuator"
    NEEDED: ClassVar = {
        "identify": ("text",),
        "set_attenuation": (),
        "get_attenuation": ("value",),
        "open": (),
        "shut": (),
        "get_open": ("value",),
        "error": ("code", "text"),
    }
    SPARED: ClassVar = ("open", "get_open")

    def require_complete(self) -> None:
        """Without a shutter the largest attenuation must be known too."""
        super().require_complete()
        if "get_open" not in self.commands and math.isinf(self.range("attenuation").high):
            raise NotConfigured(
                f"{self.source}: commands.set_attenuation.max is missing: without get_open, it is shut where its "
                f"attenuation is max"
            )

    @classmethod
    def named(cls, file: Path | None) -> "AttenuatorTable":
        """The table that a section names.

        Raises:
            NotConfigured: it names none, or one that cannot be read.
        """
        if file is None:
            raise NotConfigured("attenuator.commands is missing: name the file with the attenuator's commands")
        return cls.read(SIMULATED_TABLE if str(file) == SIMULATED else file)


DRIVER = Driver(
    section=TableAttenuatorSection,
    open=lambda section, opening: TableAttenuator(
        TableLink(
            opening.address,
            AttenuatorTable.named(section.commands).ready(attended=opening.attended),
            name="attenuator",
            transcript=opening.transcript,
        )
    ),
    sent_anew=("attenuation_db", "open"),
)


class TableAttenuator(Attenuator):
    """An attenuator behind a verified command table; the table's attenuations are in dB."""

    def __init__(self, link: TableLink) -> None:
        """Drive the attenuator behind `link`."""
        self._link = link
        self._has_shutter = "get_open" in link.table.commands
        self._set_db: float | None = None

    def identify(self) -> Identity:
        """What the `identify` command answers."""
        return Identity.parse(self._link.text("identify"))

    def examine(self) -> Examination:
        """The error queue, and the limits of the table."""
        limits = {"attenuation": self._link.table.range("attenuation")}
        return Examination(errors=tuple(self._link.errors()), limits=limits)

    def self_test(self) -> None:
        """Ask whether it is open; the table knows no other test."""
        with self._link.checked():
            self._lets_through()

    def open(self, attenuation_db: float) -> float:
        """Set the attenuation while it is shut, compare with the read-back (tolerance 0.1 dB), and open it."""
        self._set_db = self._link.set("attenuation", attenuation_db, TOLERANCE_DB)
        if self._has_shutter:
            with self._link.checked():
                self._link.send("open")
        if self._lets_through() != 1:
            raise InstrumentError("attenuator: is shut after open: check its front panel")
        return self._set_db

    def require_open(self) -> None:
        """Read-back of the shutter, or of the attenuation."""
        if self._lets_through() != 1:
            raise LightLost("attenuator: is shut and was open: check its front panel")

    def shut(self) -> None:
        """Shut, by its own answer, whatever its error queue says."""
        self._set_db = None
        self._link.send("shut")
        errors, is_open = self._link.errors(), self._lets_through()
        confirm_off("attenuator: still open after shut", is_open, errors, "check its front panel")

    def changes(self) -> tuple[Change, ...]:
        """The attenuation that was set."""
        if self._set_db is None or (now := self._link.number("get_attenuation")) == self._set_db:
            return ()
        return (Change("attenuation", f"{self._set_db:g}", f"{now:g}"),)

    def settings(self) -> dict[str, str | float]:
        """Attenuation, and whether it is open."""
        return {
            "model": self._link.table.model,
            "table_verified": str(self._link.table.verified).lower(),
            "attenuation_db": self._link.number("get_attenuation"),
            "open": self._lets_through(),
        }

    def make_safe(self) -> None:
        """Shut, sent even to an attenuator that no longer answers."""
        self.shut()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _lets_through(self) -> float:
        """What the shutter answers, 1 where it is open; without one, whether the attenuation is below the largest."""
        if self._has_shutter:
            return self._link.number("get_open")
        largest_db = self._link.table.range("attenuation").high
        return float(self._link.number("get_attenuation") < largest_db - TOLERANCE_DB)
