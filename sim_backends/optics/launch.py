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

    def power_w(self, parameters: Parameters, laser_w: float) -> float:
        """The power that goes into the fibre (W) while the laser gives `laser_w`."""
        return laser_w * _to_the_fibre(parameters) * self.transmission(parameters, laser_w)

    def transmission(self, parameters: Parameters, laser_w: float) -> float:
        """What amplifier and attenuator make of the power in the fibre: 1 is the booster alone; `laser_w` above 0."""
        attenuator = power_ratio(-self.attenuation_db)
        if self.amplified_w is None:
            return attenuator
        incoming_w = laser_w * power_ratio(-parameters.modulator_loss_db)
        outgoing_w = self.amplified_w or incoming_w * power_ratio(UNPUMPED_DB)
        return attenuator * outgoing_w / (laser_w * _to_the_fibre(parameters))


def _to_the_fibre(parameters: Parameters) -> float:
    """From the laser through modulator and booster; the direct path has no booster."""
    booster_db = parameters.booster_gain_db if parameters.light_path == "projector" else 0.0
    return power_ratio(booster_db - parameters.modulator_loss_db)
