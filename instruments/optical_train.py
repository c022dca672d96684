"""What may stand behind the laser, and its interlocks: a power meter, an amplifier, and behind that an attenuator.

The amplifier is on only while its seed is there and within the limit: the energy that it stores without a seed comes
out in one pulse with the next light. The attenuator is behind it, shut first and opened last, so that what is over a
limit, or not yet known to be within, goes nowhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from instruments.errors import InstrumentError
from instruments.interfaces import Amplifier, Attenuator, Instrument, PowerMeter, TunableLaser
from instruments.limits import Limits

SEEN = 0.5
"""The part of what the laser says it gives that a power meter must see of it: less is a fibre that leads elsewhere."""


@dataclass(frozen=True)
class OpticalTrain:
    """The instruments behind the laser that a bench has, and what they are set to while there is light.

    tap: the part of the laser's light that reaches the power meter. amplified_w: what the amplifier gives.
    attenuation_db: of the attenuator.
    """

    power_meter: PowerMeter | None = None
    tap: float = 1.0
    amplifier: Amplifier | None = None
    amplified_w: float = 0.0
    attenuator: Attenuator | None = None
    attenuation_db: float = 0.0

    @property
    def instruments(self) -> Mapping[str, Instrument]:
        """Those that there are, by the names of their roles."""
        found = {"attenuator": self.attenuator, "amplifier": self.amplifier, "power_meter": self.power_meter}
        return {name: instrument for name, instrument in found.items() if instrument is not None}

    def shut(self) -> None:
        """Attenuator shut, then amplifier off: what comes before the laser is switched, tuned or switched off.

        Raises:
            InstrumentError: one of them does not obey.
        """
        if self.attenuator is not None:
            self.attenuator.shut()
        if self.amplifier is not None:
            self.amplifier.switch_off()

    def follow(self, wavelength_nm: float) -> None:
        """The light has another wavelength: the power meter corrects for it.

        Raises:
            InstrumentError: the power meter does not go there.
        """
        if self.power_meter is not None:
            self.power_meter.set_wavelength(wavelength_nm)

    def let_through(self, laser: TunableLaser, limits: Limits) -> dict[str, float]:
        """The laser emits: compare its power, switch the amplifier on, compare that, and open the attenuator.

        Returns what was found, of the instruments there are: `measured_w`, what the laser gives by the power meter;
        `amplified_w`, what the amplifier says it gives; `attenuation_db`.

        Raises:
            OverLimit: there is more than a limit of the station; the attenuator is still shut.
            InstrumentError: the laser's light is not there, or one of them does not obey.
        """
        found = {}
        if self.power_meter is not None:
            said_w, seen_w = laser.power(), self._laser_power(self.power_meter)
            limits.check_measured_power(seen_w)
            found["measured_w"] = seen_w
            if not seen_w >= SEEN * said_w:
                raise InstrumentError(
                    f"power_meter: sees {seen_w * 1e3:.4g} mW of the laser, which says it gives {said_w * 1e3:.4g} mW: "
                    f"check the fibre from laser to tap, and power_meter.tap"
                )
        if self.amplifier is not None:
            laser.require_emission()
            self.amplifier.set_power(self.amplified_w)
            self.amplifier.switch_on()
            found["amplified_w"] = self._amplified_power(self.amplifier, limits)
        if self.attenuator is not None:
            found["attenuation_db"] = self.attenuator.open(self.attenuation_db)
        return found

    def require_light(self) -> None:
        """Check that the light is let through still.

        Raises:
            LightLost: the amplifier is off, or the attenuator shut.
        """
        if self.amplifier is not None:
            self.amplifier.require_on()
        if self.attenuator is not None:
            self.attenuator.require_open()

    def check_powers(self, limits: Limits) -> dict[str, float]:
        """Compare what the power meter sees, and what the amplifier says, with the limits of the station.

        Returns both powers, as `let_through` does.

        Raises:
            OverLimit: there is more.
            InstrumentError: one of them does not answer, or cannot tell.
        """
        found = {}
        if self.power_meter is not None:
            found["measured_w"] = self._laser_power(self.power_meter)
            limits.check_measured_power(found["measured_w"])
        if self.amplifier is not None:
            found["amplified_w"] = self._amplified_power(self.amplifier, limits)
        return found

    def _laser_power(self, meter: PowerMeter) -> float:
        return meter.power() / self.tap

    def _amplified_power(self, amplifier: Amplifier, limits: Limits) -> float:
        power_w = amplifier.power()
        limits.check_amplified_power(power_w)
        return power_w
