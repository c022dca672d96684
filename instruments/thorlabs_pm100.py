"""Thorlabs PM100 class of optical power meters: PM100D, PM100A, PM100USB, PM400.

Sources of the commands: the package ThorlabsPM100 (its class documentation names each SCPI command), the driver
`thorlabspm100usb.py` of PyMeasure, `Thorlab_PM100D` of qcodes_contrib_drivers.
"""

import re
from typing import Annotated

from pydantic import Field

from instruments.driver import Driver
from instruments.errors import InstrumentError
from instruments.interfaces import PowerMeter
from instruments.kept_settings import KeptSettings, Setting
from instruments.sections import PowerMeterSection, Timeout
from instruments.values import Change, Examination, Identity, Range
from instruments.visa import VisaLink, number_in


class Pm100Section(PowerMeterSection):
    """The optical power meter, behind a tap of the laser's output."""

    averages: Annotated[int, Field(ge=1, le=3000, description="Readings of about 3 ms that make one.")] = 10
    timeout: Timeout = 15.0


DRIVER = Driver(
    section=Pm100Section,
    open=lambda section, opening: Pm100(
        VisaLink(opening.address, name="power_meter", timeout_s=section.timeout, transcript=opening.transcript),
        averages=section.averages,
    ),
    identity=re.compile(r"Thorlabs.*PM(100|400)", re.IGNORECASE),
    sent_anew=("wavelength_nm", "averages", "unit", "auto_range", "delta", "correction_db"),
)

WAVELENGTH_TOLERANCE_NM = 0.5
"""Sensors are calibrated in steps of some nanometres; readings change by less than 0.1 % in this."""

LEFTOVERS = (
    Setting("SENSe:POWer:UNIT", "W"),
    Setting("SENSe:POWer:RANGe:AUTO", "ON"),
    Setting("SENSe:POWer:REFerence:STATe", "OFF", name="delta mode"),
    Setting("SENSe:CORRection:LOSS:INPut:MAGNitude", "0", tolerance=1e-3, unit="dB"),
)
"""What others leave behind that changes readings. The tap is counted once: in the station file, not as a loss here."""

ZERO = "SENSe:CORRection:COLLect:ZERO:MAGNitude?"
"""What is taken off each reading (W), since somebody zeroed the sensor: noted, and compared, but never set."""


class Pm100(PowerMeter):
    """A power meter with a photodiode sensor."""

    def __init__(self, link: VisaLink, *, averages: int) -> None:
        """Drive the console behind `link`, so many readings making one."""
        self._link = link
        self._kept = KeptSettings(link)
        self._averages = averages

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def examine(self) -> Examination:
        """The sensor, the error queue, and the wavelengths that the sensor is calibrated for."""
        return Examination(
            options=self._link.query("SYSTem:SENSor:IDN?").replace('"', ""),
            errors=tuple(self._link.errors()),
            limits={"wavelength": self._wavelengths()},
        )

    def self_test(self) -> None:
        """A sensor is connected, and a reading comes; it has no other test."""
        if "no sensor" in (sensor := self._link.query("SYSTem:SENSor:IDN?")).lower():
            raise InstrumentError(f"power_meter: answers {sensor!r} for its sensor: connect one, and switch it on anew")
        with self._link.checked():
            self._link.query("MEASure:POWer?")

    def set_wavelength(self, wavelength_nm: float) -> float:
        """Set all that changes readings, and keep what was answered; returns the wavelength that is corrected for."""
        self._wavelengths().check("power_meter wavelength", wavelength_nm)
        wavelength = Setting("SENSe:CORRection:WAVelength", f"{wavelength_nm:.2f}", WAVELENGTH_TOLERANCE_NM, "nm")
        averages = Setting("SENSe:AVERage:COUNt", f"{self._averages}")
        settled, *_ = self._kept.set((wavelength, averages, *LEFTOVERS))
        self._kept.keep((ZERO,))
        return float(settled)

    def power(self) -> float:
        """`MEASure:POWer?`, W; a sensor that sees more than it measures answers 9.9E37."""
        answer = self._link.query("MEASure:POWer?")
        if (measured_w := number_in(answer)) is None:
            raise InstrumentError(
                f"power_meter: answers {answer!r} for the power: there is more than the sensor measures, or none is "
                f"connected"
            )
        return measured_w

    def changes(self) -> tuple[Change, ...]:
        """Everything that changes readings."""
        return self._kept.changes()

    def settings(self) -> dict[str, str | float]:
        """Sensor, wavelength, averages, unit, range, delta mode, correction and zero."""
        return {
            "sensor": self._link.query("SYSTem:SENSor:IDN?").replace('"', ""),
            "wavelength_nm": self._link.number("SENSe:CORRection:WAVelength?"),
            "averages": self._link.number("SENSe:AVERage:COUNt?"),
            "unit": self._link.query("SENSe:POWer:UNIT?"),
            "auto_range": self._link.number("SENSe:POWer:RANGe:AUTO?"),
            "delta": self._link.number("SENSe:POWer:REFerence:STATe?"),
            "correction_db": self._link.number("SENSe:CORRection:LOSS:INPut:MAGNitude?"),
            "zero_w": self._link.number(ZERO),
        }

    def make_safe(self) -> None:
        """Nothing to do: it gives no light."""

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _wavelengths(self) -> Range:
        low, high = (self._link.number(f"SENSe:CORRection:WAVelength? {end}") for end in ("MINimum", "MAXimum"))
        return Range(low, high, "nm")
