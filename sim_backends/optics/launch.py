"""What may stand between modulator and fibre: an amplifier in the place of the fixed booster, and an attenuator.

Everything behind the modulator is linear in the optical power, so both are one factor on the laser's power. Without
either, the factor is exactly 1: the booster is part of `Parameters.projector_transmission`.
"""

from dataclasses import dataclass

from sim_backends.parameters import Parameters, power_ratio

UNPUMPED_DB = -30.0
"""What an erbium fibre without pump lets through. Recalled: tens of dB of ground-state absorption."""


@dataclass(frozen=True)
class Launch:
    """Amplifier and attenuator as they are set.

    amplified_w: output power that the amplifier keeps, whatever comes in: neither the time it takes for that, nor the
    most that it can give, nor its own spontaneous emission are simulated. 0: its pump is off; None: there is none, and
    the booster has its gain. attenuation_db: infinity is shut.
    """

    amplified_w: float | None = None
    attenuation_db: float = 0.0

    def amplified_power_w(self, parameters: Parameters, laser_w: float) -> float:
        """What amplifier or booster gives (W) while the laser gives `laser_w`."""
        if self.amplified_w is None:
            return laser_w * _boosted(parameters)
        return self.amplified_w or laser_w * power_ratio(UNPUMPED_DB - parameters.modulator_loss_db)

    def transmission(self, parameters: Parameters, laser_w: float) -> float:
        """What amplifier and attenuator make of the power in the fibre: 1 is the booster alone; `laser_w` above 0."""
        attenuator = power_ratio(-self.attenuation_db)
        if self.amplified_w is None:
            return attenuator
        return attenuator * self.amplified_power_w(parameters, laser_w) / (laser_w * _boosted(parameters))


def _boosted(parameters: Parameters) -> float:
    """Transmission of modulator and booster; the direct path has no booster."""
    booster_db = parameters.booster_gain_db if parameters.light_path == "projector" else 0.0
    return power_ratio(booster_db - parameters.modulator_loss_db)
