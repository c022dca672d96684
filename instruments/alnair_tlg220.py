"""Alnair Labs TLG-220 tunable laser, driven from a command table that the operator can correct."""

import re
import time
from typing import Annotated

from pydantic import Field

from instruments.driver import Driver
from instruments.errors import InstrumentError, LightLost
from instruments.interfaces import TunableLaser
from instruments.laser_table import DEFAULT_TABLE, LaserTable
from instruments.readback import confirm, confirm_off
from instruments.sections import File, LaserSection
from instruments.table_link import TableLink
from instruments.units import decibels_milliwatt, watts
from instruments.values import Change, Examination, Identity


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
        TableLink(
            opening.address,
            _table(section).ready(attended=opening.attended),
            name="laser",
            transcript=opening.transcript,
        )
    ),
    identity=re.compile(r"Alnair.*TLG-?2\d0", re.IGNORECASE),
    sent_anew=("wavelength_nm", "power_dbm", "emitting"),
    ranges=lambda section: _table(section).ranges(),
)

WAVELENGTH_TOLERANCE_NM = 0.01
POWER_TOLERANCE_DB = 0.2
WANDERING = {"get_wavelength": 0.002, "get_power": 0.05}
"""How far the answers of a laser that nobody sets may lie from those at first, nm and dBm."""


class Tlg220(TunableLaser):
    """A TLG-220 behind a verified command table."""

    switches_itself = True

    def __init__(self, link: TableLink) -> None:
        """Drive the laser behind `link`."""
        self._link = link
        self._settled: dict[str, float] = {}

    def identify(self) -> Identity:
        """What the `identify` command answers."""
        return Identity.parse(self._link.text("identify"))

    def examine(self) -> Examination:
        """The error queue, and the limits of the table."""
        limits = {quantity: self._link.table.range(quantity) for quantity in ("wavelength", "power")}
        return Examination(errors=tuple(self._link.errors()), limits=limits)

    def self_test(self) -> None:
        """Ask for the error queue: the table knows no other test that needs no light."""
        with self._link.checked():
            self._link.number("get_output")

    def tune(self, wavelength_nm: float) -> float:
        """Set the wavelength, wait until settled, and compare with the read-back (tolerance 10 pm)."""
        self._link.request("wavelength", wavelength_nm)
        self._settle()
        self._settled["get_wavelength"] = settled = confirm(
            "laser: wavelength",
            wavelength_nm,
            self._link.number("get_wavelength"),
            WAVELENGTH_TOLERANCE_NM,
            unit="nm",
            remedy="check its tuning range",
        )
        return settled

    def set_power(self, power_w: float) -> float:
        """Set the output power and compare with the read-back (tolerance 0.2 dB)."""
        power_dbm = decibels_milliwatt(power_w)
        self._link.request("power", power_dbm)
        self._settled["get_power"] = settled_dbm = confirm(
            "laser: power",
            power_dbm,
            self._link.number("get_power"),
            POWER_TOLERANCE_DB,
            unit="dBm",
            remedy="check its power range",
        )
        return watts(settled_dbm)

    def power(self) -> float:
        """What `get_power` answers."""
        return watts(self._link.number("get_power"))

    def emit(self) -> None:
        """Emission on, settled."""
        with self._link.checked():
            self._link.send("output_on")
        self._settle()

    def require_emission(self) -> None:
        """Read-back of the emission; where there is none, the error queue may say why."""
        if self._link.number("get_output") != 1:
            reasons = "; ".join(self._link.errors()[:1]) or "it does not say why"
            raise LightLost(f"laser: the light went out by itself ({reasons}): check interlock and front panel")

    def darken(self) -> None:
        """Emission off, by its own answer: what the error queue says, of an open interlock say, does not count."""
        self._link.send("output_off")
        errors, emitting = self._link.errors(), self._link.number("get_output")
        confirm_off("laser: still emits after output_off", emitting, errors, "use its key switch")

    def changes(self) -> tuple[Change, ...]:
        """Wavelength and power, as far as they are not what they wander by."""
        found = []
        for question, then in self._settled.items():
            now = self._link.number(question)
            if abs(now - then) > WANDERING[question]:
                found.append(Change(question.removeprefix("get_"), f"{then:g}", f"{now:g}"))
        return tuple(found)

    def settings(self) -> dict[str, str | float]:
        """Wavelength, power and whether it emits."""
        return {
            "model": self._link.table.model,
            "table_verified": str(self._link.table.verified).lower(),
            "wavelength_nm": self._link.number("get_wavelength"),
            "power_dbm": self._link.number("get_power"),
            "emitting": self._link.number("get_output"),
        }

    def make_safe(self) -> None:
        """Emission off, sent even to a laser that no longer answers."""
        self.darken()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _settle(self) -> None:
        command = self._link.table.commands["is_settled"]
        deadline = time.monotonic() + command.timeout_s
        while self._link.number("is_settled") != 1:
            if time.monotonic() > deadline:
                raise InstrumentError(f"laser: not settled after {command.timeout_s:g} s: check its front panel")
            time.sleep(command.poll_s)


def _table(section: Tlg220Section) -> LaserTable:
    return LaserTable.read(section.commands or DEFAULT_TABLE)
