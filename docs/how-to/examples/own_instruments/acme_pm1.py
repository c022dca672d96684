"""A driver of one's own for a role that labctl knows: a power meter."""

import re
from typing import Annotated

from pydantic import Field

from instruments.driver import Driver
from instruments.interfaces import PowerMeter
from instruments.kept_settings import KeptSettings, Setting
from instruments.sections import PowerMeterSection, Timeout
from instruments.values import Change, Examination, Identity
from instruments.visa import VisaLink


class Pm1Section(PowerMeterSection):
    """The optical power meter."""

    averages: Annotated[int, Field(ge=1, le=1000, description="Readings that make one.")] = 1
    timeout: Timeout = 5.0


DRIVER = Driver(
    section=Pm1Section,
    open=lambda section, opening: Pm1(
        VisaLink(opening.address, name="power_meter", timeout_s=section.timeout, transcript=opening.transcript),
        averages=section.averages,
    ),
    identity=re.compile("ACME PM-1", re.IGNORECASE),
    sent_anew=("wavelength_nm", "averages"),
)


class Pm1(PowerMeter):
    """A power meter that is set by two commands and read by one."""

    def __init__(self, link: VisaLink, *, averages: int) -> None:
        """Drive the meter behind `link`, so many readings making one."""
        self._link = link
        self._kept = KeptSettings(link)
        self._averages = averages

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def examine(self) -> Examination:
        """The error queue, for `labctl check`."""
        return Examination(errors=tuple(self._link.errors()))

    def self_test(self) -> None:
        """Measure what there is; the error queue is read at the end of the block."""
        with self._link.checked():
            self.power()

    def set_wavelength(self, wavelength_nm: float) -> float:
        """Set wavelength and averages, and keep what was answered to compare with later."""
        answers = self._kept.set(
            (
                Setting("WAVelength", f"{wavelength_nm:.3f}", tolerance=0.01, unit="nm"),
                Setting("AVERages", f"{self._averages}"),
            )
        )
        return float(answers[0])

    def power(self) -> float:
        """`POWer?`, W."""
        return self._link.number("POWer?")

    def changes(self) -> tuple[Change, ...]:
        """What somebody else has set meanwhile."""
        return self._kept.changes()

    def settings(self) -> dict[str, str | float]:
        """What the manifest keeps: settings, never readings."""
        return {"wavelength_nm": self._link.number("WAVelength?"), "averages": self._link.number("AVERages?")}

    def make_safe(self) -> None:
        """Nothing to do: it gives no light."""

    def close(self) -> None:
        """Close the link."""
        self._link.close()
