"""Santec TSL-570 tunable laser.

Sources of the commands: `qmi/instruments/santec/tsl_570.py` of QMI, which speaks the legacy command set (nm, dBm;
messages end with CR; one command a message), and `pymeasure/instruments/santec/tsl570.py` for the shutter and for the
command sets: in the SCPI one, the same headers are in metres. Fine tuning (-100 to 100, in no unit) and the state of a
sweep (0: stopped) are as public drivers of this laser have them.
"""

import math
import re
import time
from collections.abc import Sequence

from instruments.driver import Driver, LaserRanges
from instruments.errors import InstrumentError, LightLost
from instruments.interfaces import TunableLaser
from instruments.kept_settings import Setting
from instruments.readback import confirm_off
from instruments.sections import LaserSection, Timeout
from instruments.units import decibels_milliwatt, watts
from instruments.values import Change, Examination, Identity, Range
from instruments.visa import VisaLink, scpi_error_queue

POWER = Range(-15.0, 13.0, "dBm")
"""QMI, from the data sheet. What a unit gives at a wavelength may be less: it then refuses with its own error."""
ANY_WAVELENGTH = Range(-math.inf, math.inf, "nm")
"""There are units for several bands: which one this is, it is asked before it is tuned."""


class Tsl570Section(LaserSection):
    """The light source. `armed` allows light."""

    timeout: Timeout = 5.0


SETTLING_S, POLL_S = 30.0, 0.1
WAVELENGTH_TOLERANCE_NM = 0.001
POWER_TOLERANCE_DB = 0.05
NO_ALERTS = "No alerts"

LEGACY = Setting("SYSTem:COMMunicate:CODe", "0")
"""First of all: in the other command set the same number is another wavelength."""
FINE = "WAVelength:FINe"
"""A hand at the front panel turns it. `tune` ends it, and what is answered then must stay."""
LEFTOVERS = (
    Setting("WAVelength:SWEep:STATe", "0"),
    Setting("WAVelength:UNIT", "0"),
    Setting("WAVelength:OFFSet", "0", tolerance=1e-5, unit="nm"),
    Setting("COHCtrl", "0"),
    Setting("AM:STATe", "0"),
    Setting("POWer:UNIT", "0"),
    Setting("POWer:ATTenuation:AUTo", "1"),
)
"""What others leave behind that changes light, or what numbers mean: a sweep, units, offset, linewidth, modulation."""

DRIVER = Driver(
    section=Tsl570Section,
    open=lambda section, opening: Tsl570(
        VisaLink(
            opening.address,
            name="laser",
            timeout_s=section.timeout,
            transcript=opening.transcript,
            error_queue=scpi_error_queue,
            write_eol="\r",
            read_eol="\r",
        )
    ),
    identity=re.compile(r"santec.*TSL-?570", re.IGNORECASE),
    sent_anew=(
        *("wavelength_nm", "power_dbm", "emitting", "shutter_closed", FINE),
        *(setting.command for setting in (LEGACY, *LEFTOVERS)),
    ),
    ranges=lambda _section: LaserRanges(ANY_WAVELENGTH, POWER, "driver santec-tsl-570"),
)


class Tsl570(TunableLaser):
    """A TSL-570 behind its Ethernet socket."""

    switches_itself = True

    def __init__(self, link: VisaLink) -> None:
        """Drive the laser behind `link`."""
        self._link = link
        self._kept: dict[str, str] = {}

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def examine(self) -> Examination:
        """The error queue, its alerts, and where it tunes."""
        alert = self._link.query(":SYSTem:ALERt?")
        errors = (*self._link.errors(), *(() if alert.startswith(NO_ALERTS) else (alert,)))
        return Examination(errors=errors, limits={"wavelength": self._wavelengths(), "power": POWER})

    def self_test(self) -> None:
        """Ask whether it emits; it has no test that needs no light."""
        with self._link.checked():
            self._link.number(":POWer:STATe?")

    def tune(self, wavelength_nm: float) -> float:
        """Set the wavelength, wait until it rests, and compare with the read-back (tolerance 1 pm)."""
        self._clear_up()
        self._wavelengths().check("laser wavelength", wavelength_nm)
        with self._link.checked():
            self._link.write(":WAVelength:FINetuning:DISable")
            self._link.write(f":WAVelength {wavelength_nm:.4f}")
        self._settle()
        self._kept[f"{FINE}?"] = self._link.query(f":{FINE}?")
        return self._confirmed("WAVelength", wavelength_nm, WAVELENGTH_TOLERANCE_NM, "nm")

    def set_power(self, power_w: float) -> float:
        """Set the output power and compare with the read-back (tolerance 0.05 dB)."""
        power_dbm = decibels_milliwatt(power_w)
        POWER.check("laser power", power_dbm)
        self._clear_up()
        with self._link.checked():
            self._link.write(f":POWer {power_dbm:.2f}")
        self._settle()
        return watts(self._confirmed("POWer", power_dbm, POWER_TOLERANCE_DB, "dBm"))

    def power(self) -> float:
        """What its monitor sees, W."""
        return watts(self._link.number(":POWer:ACTual?"))

    def emit(self) -> None:
        """Shutter open, emission on, at rest."""
        with self._link.checked():
            self._link.write(":POWer:SHUTter 0")
            self._link.write(":POWer:STATe 1")
        self._settle()
        self.require_emission()

    def require_emission(self) -> None:
        """`:POWer:STATe?` must be 1, where it is not an alert may say why; and the shutter must be open."""
        if self._link.number(":POWer:STATe?") != 1:
            alert = self._link.query(":SYSTem:ALERt?")
            raise LightLost(f"laser: the light went out by itself ({alert}): check interlock and front panel")
        if self._link.number(":POWer:SHUTter?") != 0:
            raise LightLost("laser: its shutter is closed and was open: check its front panel")

    def darken(self) -> None:
        """Emission off, by its own answer, whatever its error queue says."""
        self._link.write(":POWer:STATe 0")
        errors, emits = self._link.errors(), self._link.number(":POWer:STATe?")
        confirm_off("laser: still emits after POWer:STATe 0", emits, errors, "use its key switch")

    def changes(self) -> tuple[Change, ...]:
        """Everything that was set, asked one by one: the legacy command set has no chains."""
        now = {question: self._link.query(f":{question}") for question in self._kept}
        return tuple(
            Change(question.removesuffix("?"), then, now[question])
            for question, then in self._kept.items()
            if now[question] != then
        )

    def settings(self) -> dict[str, str | float]:
        """Wavelength, power, emission, shutter, and what others leave behind."""
        left = {setting.command: self._link.number(f":{setting.question}") for setting in (LEGACY, *LEFTOVERS)}
        return {
            "wavelength_nm": self._nanometres(":WAVelength?"),
            FINE: self._link.number(f":{FINE}?"),
            "power_dbm": self._link.number(":POWer?"),
            "emitting": self._link.number(":POWer:STATe?"),
            "shutter_closed": self._link.number(":POWer:SHUTter?"),
            **left,
        }

    def make_safe(self) -> None:
        """Emission off and shutter closed, sent even to a laser that no longer answers."""
        self._link.write(":POWer:STATe 0")
        self._link.write(":POWer:SHUTter 1")
        self.darken()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _clear_up(self) -> None:
        for settings in ((LEGACY,), LEFTOVERS):
            self._set(settings)

    def _set(self, settings: Sequence[Setting]) -> None:
        with self._link.checked():
            for setting in settings:
                self._link.write(f":{setting.message}")
        for setting in settings:
            self._kept[setting.question] = answer = self._link.query(f":{setting.question}")
            setting.check("laser", answer)

    def _confirmed(self, header: str, asked: float, tolerance: float, unit: str) -> float:
        answer = self._kept[f"{header}?"] = self._link.query(f":{header}?")
        Setting(header, f"{asked:.4f}", tolerance, unit).check("laser", answer)
        return float(answer)

    def _wavelengths(self) -> Range:
        return Range(self._nanometres(":WAVelength:MINimum?"), self._nanometres(":WAVelength:MAXimum?"), "nm")

    def _nanometres(self, question: str) -> float:
        """What it answers: in metres where somebody has left it in the other command set, in which it is only asked."""
        legacy = self._link.query(f":{LEGACY.question}") == LEGACY.value
        return self._link.number(question) * (1 if legacy else 1e9)

    def _settle(self) -> None:
        """`*OPC?` answers at once, 0 until it rests."""
        deadline = time.monotonic() + SETTLING_S
        while self._link.number("*OPC?") != 1:
            if time.monotonic() > deadline:
                raise InstrumentError(f"laser: not settled after {SETTLING_S:g} s: check its front panel")
            time.sleep(POLL_S)
