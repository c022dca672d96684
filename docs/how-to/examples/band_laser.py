"""A driver of one's own: a tunable laser that is sold for one of two bands."""

import math
import re
from typing import Annotated, Literal

from pydantic import Field

from instruments.driver import Driver, LaserRanges
from instruments.errors import InstrumentError
from instruments.interfaces import TunableLaser
from instruments.readback import confirm, confirm_off
from instruments.sections import LaserSection, Timeout
from instruments.values import Examination, Identity, Range
from instruments.visa import MAX_ERRORS_READ, VisaLink

BANDS = {"C": Range(1528, 1566, "nm"), "L": Range(1566, 1610, "nm")}
POWER = Range(6, 16, "dBm")


class BandLaserSection(LaserSection):
    """The light source."""

    band: Annotated[Literal["C", "L"], Field(description="Which of its two models it is.")] = "C"
    timeout: Timeout = 5.0


DRIVER = Driver(
    section=BandLaserSection,
    open=lambda section, opening: BandLaser(
        VisaLink(
            opening.address,
            name="laser",
            timeout_s=section.timeout,
            transcript=opening.transcript,
            error_queue=errors,
        ),
        tuning=BANDS[section.band],
    ),
    identity=re.compile("ACME BL-1", re.IGNORECASE),
    sent_anew=("wavelength_nm", "power_dbm", "emitting"),
    ranges=lambda section: LaserRanges(BANDS[section.band], POWER, f"band {section.band}", key="band"),
)


class BandLaser(TunableLaser):
    """A laser that takes a line a setting, and says `*OPC?` when it rests."""

    switches_itself = True
    TUNING_S = 30.0

    def __init__(self, link: VisaLink, *, tuning: Range) -> None:
        """Drive the laser behind `link`, which tunes over `tuning` (nm)."""
        self._link = link
        self._tuning = tuning

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def examine(self) -> Examination:
        """The error queue and the ranges, for `labctl check`."""
        limits = {"wavelength": self._tuning, "power": POWER}
        return Examination(errors=tuple(self._link.errors()), limits=limits)

    def self_test(self) -> None:
        """Ask whether it emits; the error queue is read at the end of the block."""
        with self._link.checked():
            self._link.number("OUTPUT?")

    def tune(self, wavelength_nm: float) -> float:
        """Set the wavelength, wait until the laser rests, and return the one it settled on."""
        self._tuning.check("laser wavelength", wavelength_nm)
        with self._link.checked():
            self._link.write(f"WAVELENGTH {wavelength_nm:.4f}")
            self._link.query("*OPC?", timeout_s=self.TUNING_S)
        return confirm("laser: wavelength", wavelength_nm, self._link.number("WAVELENGTH?"), 0.01, unit="nm")

    def set_power(self, power_w: float) -> float:
        """Set the power and return the one the laser settled on."""
        power_dbm = 10 * math.log10(power_w / 1e-3) if power_w > 0 else -math.inf
        POWER.check("laser power", power_dbm)
        with self._link.checked():
            self._link.write(f"POWER {power_dbm:.2f}")
        confirm("laser: power", power_dbm, self._link.number("POWER?"), 0.2, unit="dBm")
        return self.power()

    def power(self) -> float:
        """`POWER?`, in W."""
        return float(1e-3 * 10 ** (self._link.number("POWER?") / 10))

    def emit(self) -> None:
        """Emission on, settled."""
        with self._link.checked():
            self._link.write("OUTPUT ON")
            self._link.query("*OPC?", timeout_s=self.TUNING_S)

    def require_emission(self) -> None:
        """`OUTPUT?` must be 1."""
        if self._link.number("OUTPUT?") != 1:
            raise InstrumentError("laser: the light went out by itself: check interlock and front panel")

    def darken(self) -> None:
        """Emission off, by its own answer, whatever its error queue says."""
        self._link.write("OUTPUT OFF")
        errors = self._link.errors()
        confirm_off("laser: still emits after OUTPUT OFF", self._link.number("OUTPUT?"), errors, "use its key switch")

    def settings(self) -> dict[str, str | float]:
        """What the manifest keeps."""
        return {
            "wavelength_nm": self._link.number("WAVELENGTH?"),
            "power_dbm": self._link.number("POWER?"),
            "emitting": self._link.number("OUTPUT?"),
        }

    def make_safe(self) -> None:
        """Dark, sent even to a laser that no longer answers."""
        self.darken()

    def close(self) -> None:
        """Close the link."""
        self._link.close()


def errors(link: VisaLink) -> list[str]:
    """Empty the error queue: `ERROR?` answers `0,"..."` when nothing is left."""
    found: list[str] = []
    for _ in range(MAX_ERRORS_READ):
        error = link.query("ERROR?")
        if error.startswith("0,"):
            break
        found.append(error)
    return found
