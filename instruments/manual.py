"""Instruments set by hand: the operator acts, the software asks, waits and records."""

from collections.abc import Callable, Mapping

from instruments.errors import OutOfRange
from instruments.interfaces import PatchPanel, TunableLaser
from instruments.values import Identity

Ask = Callable[[str], str]
"""Shows a request to the operator and returns what was typed."""


class ManualLaser(TunableLaser):
    """A laser that software cannot reach: the operator sets it and confirms, the software keeps the record.

    It cannot be switched off by software, so a run with it needs a person beside the bench.
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
            self._ask(f"Set the laser to {wavelength_nm:g} nm, wait until it is stable, then press Enter")
            self._settings["wavelength_nm"] = wavelength_nm
        return wavelength_nm

    def set_power(self, power_w: float) -> float:
        """Ask for the power, unless it was the last one confirmed, and record it."""
        if self._settings.get("power_w") != power_w:
            self._ask(f"Set the laser to {power_w * 1e3:g} mW, then press Enter")
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


class ManualPatchPanel(PatchPanel):
    """Fibres moved by hand."""

    def __init__(self, ask: Ask, *, ports: tuple[int, ...]) -> None:
        """Ask the operator through `ask`; `ports` are the waveguides that have a fibre."""
        self._ask = ask
        self.ports = ports
        self._patching: dict[int, int] = {}

    def identify(self) -> Identity:
        """A panel without a voice."""
        return Identity("", "manual patch panel", "", "")

    def self_test(self) -> None:
        """Nothing that can be tested from here."""

    def connect(self, patching: Mapping[int, int]) -> None:
        """Ask for the connections that differ from the last ones confirmed."""
        for port in patching.values():
            if port not in self.ports:
                raise OutOfRange(f"port {port} has no fibre on the patch panel (ports {list(self.ports)})")
        if dict(patching) != self._patching:
            connections = ", ".join(f"port {port} to CH{channel}" for channel, port in sorted(patching.items()))
            self._ask(f"Connect {connections}, and nothing else, then press Enter")
            self._patching = dict(patching)

    def settings(self) -> dict[str, str | float]:
        """The connections the operator confirmed."""
        return {f"ch{channel}": port for channel, port in sorted(self._patching.items())}

    def make_safe(self) -> None:
        """Nothing to do: a fibre carries light only while the laser emits."""

    def close(self) -> None:
        """Nothing to release."""
