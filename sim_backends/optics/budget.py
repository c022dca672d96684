"""The power budget: how much of the laser's light arrives where, averaged over fibres."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import chain, fibre, mirrors
from sim_backends.parameters import PLANCK, SPEED_OF_LIGHT, Parameters, power_ratio

_CHIP_SHARE = 0.05  # of the light in the chip that leaves by one port


@dataclass(frozen=True)
class Budget:
    """Mean powers (W) with a laser of `laser_w`, and what they mean for a sample.

    fibre_end_w: behind booster and multimode fibre. collected_w: in the collected mode, in front of the preamplifier.
    chip_w: behind it, its saturation left out. detector_w: on one port. photons: of `collected_w` in a sample of 40 ps.
    scatter: of `collected_w` from fibre to fibre, relative.
    """

    fibre_end_w: float
    collected_w: float
    chip_w: float
    detector_w: float
    photons: float
    scatter: float


def power_budget(parameters: Parameters, on: NDArray[np.float32], *, laser_w: float, fibres: int = 20) -> Budget:
    """Powers while these parts of the superpixels' mirrors are on, (784,), and the drive averages over all speckle.

    Modes of different delay then add as powers, because the drive's phases are independent from symbol to symbol.
    """
    sent = mirrors.reflected(on, parameters.mirror_contrast)
    shares = []
    for seed in range(fibres):
        modes = chain.draw_fibre(parameters, np.random.default_rng(seed))
        light = chain.driven_light(
            parameters, np.random.default_rng(seed).uniform(-0.25, 0.25, 2500).astype(np.float32), 25e9
        )
        frequency = SPEED_OF_LIGHT / (parameters.design_wavelength_nm * 1e-9)
        taps, _ = fibre.delay_taps(modes, frequency_hz=frequency, step=light.step_s)
        shares.append(float(np.sum((sent @ chain.power_factors(light, taps)) ** 2)))
    collected = laser_w * parameters.projector_transmission * float(np.mean(shares))
    photon = PLANCK * SPEED_OF_LIGHT / (parameters.design_wavelength_nm * 1e-9)
    behind = collected * parameters.amplifier_gain
    return Budget(
        fibre_end_w=laser_w * parameters.projector_transmission * power_ratio(parameters.mirror_loss_db),
        collected_w=collected,
        chip_w=behind,
        detector_w=behind * chain.lead_transmission(parameters, 2) * _CHIP_SHARE,
        photons=collected * 40e-12 / photon,
        scatter=float(np.std(shares) / np.mean(shares)),
    )
