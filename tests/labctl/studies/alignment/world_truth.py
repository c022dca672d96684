"""What an alignment should find, from the twin's parameters and optics: computed here, never seen by labctl."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.bench.station import Station
from protocols.base import Images, Shot, ShotKind
from protocols.image_readout import DRIVE_SAMPLES
from protocols.patterns import Patterns
from sim_backends.optics import chain, derived, mirrors, receiver
from sim_backends.parameters import SPEED_OF_LIGHT, Parameters
from sim_backends.world.keyed_random import digest, generator
from sim_backends.world.light_path import LightPath
from sim_backends.world.signals import Acquisition, Emission, Playback
from sim_backends.world.twin import Optics, Setting

SAMPLE_RATE, SAMPLES = 25e9, 100
FINEST_V = 6.25e-3
"""V per division at which the dark is measured."""
LEVELS = 1 << 9
"""Of the generator: nine bits beside two markers."""


@dataclass(frozen=True)
class World:
    """One twin under the drive, images and patching of an alignment.

    clean: (images, channels, samples) V without noise, mean of the amplifier's own light included. slope: V/s.
    """

    parameters: Parameters
    optics: Optics
    clean: NDArray[np.float64]
    slope: NDArray[np.float64]

    @property
    def offset_v(self) -> NDArray[np.float64]:
        """Mean without light, (channels,)."""
        return np.asarray(self.optics.laws.offset_v[:, 0], np.float64)

    def dark_noise_v(self) -> NDArray[np.float64]:
        """Of a sample in the dark at the finest range: receiver, digitiser, rounding, (channels,)."""
        code = FINEST_V / receiver.CODES_PER_DIVISION
        digitiser = code**2 * (receiver.digitiser_noise_codes(self.parameters.enob) ** 2 + 1 / 12)
        return np.sqrt(np.asarray(self.optics.laws.floor[:, 0], np.float64) + digitiser)

    def repeatability_db(self, scale_v_per_div: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of the first image at these ranges, (channels,)."""
        light = self.clean[0] - self.offset_v[:, np.newaxis]
        laws = self.optics.laws
        signal = np.maximum(light, 0)
        code = scale_v_per_div[:, np.newaxis] / receiver.CODES_PER_DIVISION
        jitter_s = math.hypot(self.parameters.trigger_jitter_s, self.parameters.awg_jitter_s)
        variance = laws.floor + laws.linear * signal + laws.quadratic * signal**2
        variance = variance + (jitter_s * self.slope[0]) ** 2
        variance = variance + code**2 * (receiver.digitiser_noise_codes(self.parameters.enob) ** 2 + 1 / 12)
        found: NDArray[np.float64] = 10 * np.log10(light.var(axis=1, ddof=1) / variance.mean(axis=1))
        return found

    def contrast(self) -> NDArray[np.float64]:
        """Between the images, (channels,)."""
        light = self.clean - self.offset_v[:, np.newaxis]
        found: NDArray[np.float64] = np.sqrt(light.var(axis=0, ddof=1).mean(axis=-1)) / light.mean(axis=(0, 2))
        return found


def world(station: Station, images: Images, ports: tuple[int, ...]) -> World:
    """The twin of `station` under the pseudorandom drive of seed 1."""
    light = "projector" if station.wiring.projector else "direct"
    parameters = Parameters.model_validate({"light_path": light, **station.sim.parameters})
    path = LightPath(parameters, station.sim.twin_seed)
    samples = np.random.default_rng((1, 2)).uniform(-1.0, 1.0, DRIVE_SAMPLES).astype(np.float32)
    step = station.awg.amplitude / LEVELS
    volts = (np.rint(samples * station.awg.amplitude / 2 / step) * step).astype(np.float32)
    playback = Playback(volts, np.arange(volts.size) < 1, 0.0, 1.0, SAMPLE_RATE)
    optics = path.optics(
        Setting(Emission(station.laser.wavelength, station.laser.power), playback, ports, drift_step=0)
    )
    numbers = np.arange(len(images.images))
    shown = Patterns(Images(images.images, numbers, numbers), (mirrors.ROWS, mirrors.COLUMNS))
    bits = shown.block([Shot(n, ShotKind.IMAGE, n, n, n) for n in numbers.tolist()])
    amplitudes = path.amplitudes(mirrors.fraction(mirrors.on_counts(bits)))
    sampled = Acquisition(tuple(range(1, len(ports) + 1)), SAMPLE_RATE, SAMPLES, 0.0)
    clean, slope = path.sampled(optics, sampled, amplitudes, phase_s=0.0, shift_s=0.0)
    seen = receiver.limited(clean + optics.laws.offset_v, parameters.detector_limit_v)
    return World(parameters, optics, np.asarray(seen, np.float64), np.asarray(slope, np.float64))


def drive_phase(parameters: Parameters, amplitude_vpp: float, level: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phase (rad) of a level of the drive that lasts: pi / V_pi V_sat tanh(g V / V_sat)."""
    volts = amplitude_vpp / 2 * level
    saturated = parameters.rf_saturation_v * np.tanh(parameters.rf_gain * volts / parameters.rf_saturation_v)
    return np.asarray(math.pi / parameters.v_pi_v * saturated, np.float64)


def drive_depth(parameters: Parameters, amplitude_vpp: float) -> float:
    """From the lowest to the highest level, rad."""
    low, high = drive_phase(parameters, amplitude_vpp, np.array([-1.0, 1.0]))
    return float(high - low)


def half_width_m(parameters: Parameters, twin_seed: int) -> float:
    """Detuning at which intensities of this twin's fibre correlate by one half, s = (2/3) 40 ps / T being chance.

    |gamma|^2 of its own modes, each weighing as much as it has power on the mirrors.
    """
    modes = chain.draw_fibre(parameters, generator(digest(twin_seed, "fibre")))
    power = np.abs(modes.excitation.at(0.0)) ** 2 * np.sum(np.abs(modes.overlaps) ** 2, axis=(0, 1), dtype=np.float64)
    share = 2 / 3 * 40e-12 / derived.delay_spread_s(parameters)
    detuning_hz = np.arange(0, 3e9, 1e6)
    gamma = np.exp(-2j * np.pi * np.multiply.outer(detuning_hz, modes.delays_s)) @ (power / power.sum())
    half_hz = float(detuning_hz[np.argmax(np.abs(gamma) ** 2 < (1 + share) / 2)])
    return (parameters.design_wavelength_nm * 1e-9) ** 2 / SPEED_OF_LIGHT * half_hz


def light_delay_s(parameters: Parameters) -> float:
    """Marker edge to light: leads, and the fibre's transit or the lead in its place."""
    if parameters.light_path == "projector":
        return parameters.path_delay_s + parameters.fibre_length_m * parameters.fibre_group_index / SPEED_OF_LIGHT
    return parameters.path_delay_s + parameters.direct_lead_s
