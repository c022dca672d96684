"""A laser that is set by hand: the operator acts, the software asks, waits and records."""

from instruments.driver import Ask, Driver
from instruments.interfaces import TunableLaser
from instruments.sections import LaserSection
from instruments.units import DIGITS
from instruments.values import Identity

DRIVER = Driver(
    section=LaserSection,
    open=lambda _section, opening: ManualLaser(opening.ask),
    sent_anew=("wavelength_nm", "power_w", "emitting"),
    by_hand=True,
)


class ManualLaser(TunableLaser):
    """A laser that software cannot reach: the operator sets it and confirms, the software keeps the record.

    It cannot be switched off by software, so a run with it needs a person at the bench.
    """

    switches_itself = False

    def __init__(self, ask: Ask) -> None:
        """Ask the operator through `ask`."""
        self._ask = ask
        self._settings: dict[str, str | float] = {"emitting": 0}

    def identify(self) -> Identity:
        """A laser without a voice."""
        return Identity("", "manual laser", "", "")

    def self_test(self) -> None:
        """Nothing that can be tested from here."""

    def tune(self, wavelength_nm: float) -> float:
        """Ask for the wavelength, unless it was the last one confirmed, and record it."""
        if self._settings.get("wavelength_nm") != wavelength_nm:
            self._ask(f"Set the laser to {wavelength_nm:{DIGITS}} nm, wait until it is stable, then press Enter")
            self._settings["wavelength_nm"] = wavelength_nm
        return wavelength_nm

    def set_power(self, power_w: float) -> float:
        """Ask for the power, unless it was the last one confirmed, and record it."""
        if self._settings.get("power_w") != power_w:
            self._ask(f"Set the laser to {power_w * 1e3:{DIGITS}} mW, then press Enter")
            self._settings["power_w"] = power_w
        return power_w

    def power(self) -> float:
        """The last one confirmed; 0 before."""
        return float(self._settings.get("power_w", 0.0))

    def emit(self) -> None:
        """Ask for emission."""
        self._settings["emitting"] = 1
        self._ask("Put on laser goggles, switch the laser ON, then press Enter")

    def require_emission(self) -> None:
        """Nothing that can be known from here."""

    def darken(self) -> None:
        """Ask for darkness if the laser may be emitting."""
        if self._settings["emitting"]:
            self._ask("Switch the laser OFF, then press Enter")
            self._settings["emitting"] = 0

    def settings(self) -> dict[str, str | float]:
        """What the operator was asked for and confirmed."""
        return dict(self._settings)

    def make_safe(self) -> None:
        """Ask for darkness."""
        self.darken()

    def close(self) -> None:
        """Nothing to release."""
