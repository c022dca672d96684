"""From the generator's samples to the oscilloscope's volts on a grid of 1 ps, step by step and without short cuts.

What is random of a twin is given (`Draws`); everything else follows from its parameters: the drive's filters as
difference equations, the modes of both fibres by finite differences, their overlap mirror by mirror, each mode's own
delay, the chip's resonances as coupled differential equations in time, the detector as a difference equation again.
Sources: as the elements' own; Suh, Wang & Fan, IEEE J. Quantum Electron. 40, 1511 (2004) for coupled modes in time.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.signal import lfilter

from sim_backends.parameters import SPEED_OF_LIGHT, Parameters
from tests.solvers.fibre_modes import Fibre, modes

STEP = 1e-12
MIRRORS_SIDE, BLOCK = 756, 9  # the lit square, and how many mirrors are taken together
_CELLS = 500
_MEMORY = 2000  # steps: more than chip and detector remember


@dataclass(frozen=True, eq=False)
class Draws:
    """What is random of a twin.

    excitation: by azimuthal order, unit normal amplitudes of the first fibre's modes, (modes, 2), each with the phase
    that it arrives with: those with the largest kappa, ascending; cosine and sine, 0 where there is none. collecting:
    unit normal amplitudes of the second fibre's lowest modes, ascending in kappa, cosine before sine. resonances_hz,
    couplings: of the chip.
    """

    excitation: dict[int, NDArray[np.complex128]]
    collecting: NDArray[np.complex128]
    resonances_hz: NDArray[np.float64]
    couplings: NDArray[np.float64]


def modulated(twin: Parameters, volts: NDArray[np.float64], sample_rate: float) -> NDArray[np.complex128]:
    """Field behind the modulator, the second of two periods of the drive."""
    held = np.tile(np.repeat(volts, round(1 / (sample_rate * STEP))), 2)
    kept = np.exp(-2 * np.pi * twin.awg_bandwidth_hz * STEP)
    generated = lfilter([0.0, 1 - kept], [1.0, -kept], held)
    driven = twin.rf_saturation_v * np.tanh(twin.rf_gain / twin.rf_saturation_v * generated)
    phase = np.pi / twin.v_pi_v * one_pole(driven, twin.modulator_bandwidth_hz)
    return np.asarray(np.exp(1j * phase)[held.size // 2 :], np.complex128)


def one_pole(signal: NDArray[np.float64], bandwidth_hz: float) -> NDArray[np.float64]:
    """Low-pass of a signal that is straight between the points of the grid."""
    time = 2 * np.pi * bandwidth_hz * STEP
    kept = np.exp(-time)
    new = (1 - kept) / time
    return np.asarray(lfilter([1 - new, new - kept], [1.0, -kept], signal), np.float64)


def fibre_response(twin: Parameters, draws: Draws, mirrors: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Impulse response from the modulator into the collected mode, (delays,).

    A mode's delay lies between two points of the grid, which share it. `mirrors` (756, 756) are 1 where they are on.
    """
    wavelength = twin.design_wavelength_nm * 1e-9
    launch = Fibre(twin.core_diameter_m / 2, twin.fibre_na, twin.fibre_index, cells=_CELLS)
    side = twin.image_side * twin.core_diameter_m
    blocks = MIRRORS_SIDE // BLOCK
    along = ((np.arange(blocks) + 0.5) / blocks - 0.5) * side
    x, y = np.meshgrid(along, along)
    radius, angle = np.hypot(x, y).ravel(), np.arctan2(y, x).ravel()
    on = mirrors.reshape(blocks, BLOCK, blocks, BLOCK).mean(axis=(1, 3)).ravel()
    leaked = twin.mirror_contrast**-0.5
    taken = collected_mode(twin, draws, radius, angle) * (leaked + (1 - leaked) * on) * (side / blocks) ** 2
    latest = twin.launch_na * np.sqrt(-np.log(3e-3) / 2)  # 3 parts in 1000 of the launched power come later
    launched = modes(launch, wavelength, latest)
    sine = launched.kappa * wavelength / (2 * np.pi)
    brightness = np.exp(-2 * (sine / twin.launch_na) ** 2)
    power = brightness / np.sum(brightness * launched.weight)
    delay = (
        twin.fibre_length_m / SPEED_OF_LIGHT * (launched.group_index / twin.fibre_index - 1) * twin.fibre_group_index
    )
    response = np.zeros(round(delay.max() / STEP) + 2, np.complex128)
    radii, at = np.unique(np.round(radius, 12), return_inverse=True)
    for order, amplitudes in draws.excitation.items():
        these = np.flatnonzero(launched.order == order)[-len(amplitudes) :]
        fields = launch.radial(order, wavelength, 2 * np.pi / wavelength * latest)[-len(amplitudes) :]
        by_radius = np.array([np.interp(radii, launch.radii, field) for field in fields])
        wave = np.exp(1j * order * angle)
        plus, minus = (
            np.bincount(at, part.real) + 1j * np.bincount(at, part.imag) for part in (taken * wave, taken * wave.conj())
        )
        overlaps = by_radius @ np.stack([(plus + minus) / 2, (plus - minus) / 2j], axis=1)
        arriving = np.sqrt(power[these] / 2) * np.sum(overlaps * amplitudes, axis=1)
        place = delay[these] / STEP
        first = np.floor(place).astype(int)
        np.add.at(response, first, arriving * (1 - (place - first)))
        np.add.at(response, first + 1, arriving * (place - first))
    return response


def collected_mode(
    twin: Parameters, draws: Draws, radius: NDArray[np.float64], angle: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Field of unit power of the collected mode on the mirrors, as the first fibre's end face is imaged there (1/m)."""
    wavelength = twin.design_wavelength_nm * 1e-9
    fibre = Fibre(twin.collection_core_m / 2, twin.collection_na, twin.fibre_index, cells=_CELLS, outer=3.0)
    magnified = twin.collection_image * twin.image_side * twin.core_diameter_m / twin.collection_core_m
    highest = 2 * np.pi / wavelength * twin.collection_na
    found: list[tuple[float, int, bool, NDArray[np.float64]]] = []
    for order in range(30):
        kappas = fibre.transverse(order, wavelength, highest)
        if kappas.size:
            for kappa, field in zip(kappas, fibre.radial(order, wavelength, highest), strict=True):
                found += [(kappa, order, sine, field) for sine in ((False, True) if order else (False,))]
    found.sort(key=lambda mode: mode[:3])
    weights = draws.collecting / np.linalg.norm(draws.collecting)
    collected = np.zeros(radius.size, np.complex128)
    for weight, (_, order, sine, field) in zip(weights, found, strict=False):
        around = np.sin(order * angle) if sine else np.cos(order * angle)
        collected += weight * np.interp(radius / magnified, fibre.radii, field) * around / magnified
    return collected


def behind_chip(
    twin: Parameters, draws: Draws, field: NDArray[np.complex128], ports: tuple[int, ...]
) -> NDArray[np.complex128]:
    """Field behind `ports`, (ports, points), of light that enters by the input port; the chip is empty at first.

    da/dt = (2 pi i f - 2 pi^2 W W^T - 1 / (2 tau)) a + 2 pi i W s, b = 2 pi i W^T a, s straight between points.
    """
    decay = 2 * np.pi**2 * draws.couplings @ draws.couplings.T
    motion = np.diag(2j * np.pi * draws.resonances_hz - 1 / (2 * twin.chip_loss_lifetime_s)) - decay
    rates, shapes = np.linalg.eig(motion)
    entering = np.linalg.solve(shapes, 2j * np.pi * draws.couplings[:, twin.chip_input_port - 1])
    leaving = 2j * np.pi * draws.couplings[:, [port - 1 for port in ports]].T @ shapes
    behind = np.zeros((len(ports), field.size), np.complex128)
    for rate, driven, seen in zip(rates, entering, leaving.T, strict=True):
        kept = np.exp(rate * STEP)
        level = driven * (kept - 1) / rate
        slope = driven * (kept - 1 - rate * STEP) / (rate**2 * STEP)
        behind += np.outer(seen, lfilter([slope, level - slope], [1.0, -kept], field))
    return behind


def detected(twin: Parameters, power_w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Volts at the oscilloscope of power (W) on a detector, (points,)."""
    volts = one_pole(twin.detector_gain_v_per_w * power_w, twin.detector_bandwidth_hz)
    width = np.sqrt(np.log(2)) / (2 * np.pi * twin.scope_bandwidth_hz) / STEP
    reach = np.arange(-round(6 * width), round(6 * width) + 1)
    bell = np.exp(-0.5 * (reach / width) ** 2)
    smooth = np.convolve(volts, bell / bell.sum(), mode="same")
    return np.asarray(smooth / (1 + (smooth / twin.detector_limit_v) ** 6) ** (1 / 6), np.float64)


def record(
    twin: Parameters,
    draws: Draws,
    *,
    volts: NDArray[np.float64],
    sample_rate: float,
    mirrors: NDArray[np.float64],
    laser_w: float,
    ports: tuple[int, ...],
    times: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Volts behind `ports` at `times` (s) after the start of the drive's period, (ports, times); no noise.

    Args:
        twin: the parameters.
        draws: what is random.
        volts: one period of the generator's samples.
        sample_rate: S/s of these.
        mirrors: 1 where they are on, (756, 756).
        laser_w: laser power.
        ports: of the chip.
        times: whole steps of the grid.
    """
    light = modulated(twin, volts, sample_rate)
    response = fibre_response(twin, draws, mirrors)
    around = np.concatenate([light[-response.size + 1 :], light])
    collected = np.convolve(around, response, mode="valid")
    decibels = twin.booster_gain_db - twin.modulator_loss_db - twin.fibre_loss_db - twin.mirror_loss_db
    collected *= np.sqrt(laser_w * 10 ** (decibels / 10))
    small_signal = 10 ** (twin.amplifier_gain_db / 10)
    unsaturated = small_signal * np.mean(np.abs(collected) ** 2)
    saturated = unsaturated / twin.amplifier_saturation_w
    gain = small_signal * brentq(lambda part: part * (1 + part * saturated) - 1, 0.0, 1.0)
    leads = 10 ** (-(twin.spot_size_converter_loss_db + twin.facet_loss_db) / 10)
    transit_s = twin.fibre_length_m * twin.fibre_group_index / SPEED_OF_LIGHT
    points = np.rint((times - twin.path_delay_s - transit_s) / STEP).astype(int)
    first, last = points.min() - _MEMORY, points.max() + 100
    entering = np.sqrt(gain * leads) * collected[np.arange(first, last) % collected.size]
    behind = behind_chip(twin, draws, entering, ports)
    return np.stack([detected(twin, np.abs(port) ** 2)[points - first] for port in behind])
