"""A driver of one's own for a role that labctl does not know: a thermometer, in a table of its own."""

import re
from typing import Annotated

from pydantic import Field

from instruments.driver import Driver
from instruments.errors import InstrumentError
from instruments.interfaces import Instrument
from instruments.sections import InstrumentSection, Timeout
from instruments.values import Identity
from instruments.visa import VisaLink


class ThermometerSection(InstrumentSection):
    """The thermometer at the chip."""

    role = "thermometer"

    highest_celsius: Annotated[float, Field(description="Above this the chip is not where it was calibrated.")]
    timeout: Timeout = 5.0


DRIVER = Driver(
    section=ThermometerSection,
    open=lambda section, opening: Thermometer(
        VisaLink(opening.address, name="thermometer", timeout_s=section.timeout, transcript=opening.transcript),
        highest_celsius=section.highest_celsius,
    ),
    identity=re.compile("ACME T-1", re.IGNORECASE),
)


class Thermometer(Instrument):
    """A thermometer that answers one question."""

    def __init__(self, link: VisaLink, *, highest_celsius: float) -> None:
        """Ask the thermometer behind `link`."""
        self._link = link
        self._highest_celsius = highest_celsius

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def self_test(self) -> None:
        """The chip must not be too warm: `labctl check` says so."""
        if (celsius := self.celsius()) > self._highest_celsius:
            raise InstrumentError(f"thermometer: {celsius:.1f} degrees Celsius: let the chip cool down")

    def celsius(self) -> float:
        """`TEMPerature?`: for protocols of one's own, as `bench.others["thermometer"]`."""
        return self._link.number("TEMPerature?")

    def settings(self) -> dict[str, str | float]:
        """What the manifest keeps."""
        return {"highest_celsius": self._highest_celsius}

    def make_safe(self) -> None:
        """Nothing to do: it gives neither light nor volts."""

    def close(self) -> None:
        """Close the link."""
        self._link.close()
