"""The whole optical chain: what the instruments' settings make of the mirrors' amplitudes.

Everything in front of the photodiode is linear in the field and in the mirror amplitudes v_p, so modulator, chip and
fibre commute and fold into one set of masks. At channel m and light time t

    V_m(t) = | sum_p v_p C_pm(t) |^2   (volts behind an infinitely fast detector),

C_pm(t) = sum_d T_pd g_m(t - d dt): T the fibre's taps, g_m the modulated light behind port m of the chip. Setting the
instruments fixes both; an image then costs one real matrix product, v T, and a convolution with g: the masks C
themselves, as large as a picture times a record, are never made.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from sim_backends.optics import cavity, drive, fibre, receiver
from sim_backends.parameters import Parameters, power_ratio

BYPASS = 0
CHIP_MEMORY_S = 1024 * 5e-12
"""The chip's response is computed over so long: many times the 60 ps or so that it holds light."""
_ACAUSAL_POINTS = 128  # band limits smear the chip's response a little to negative times
_POWER_LEFT_OUT = 2e-3  # of the mean power, in what it is computed from


@dataclass(frozen=True, eq=False)
class DriveLight:
    """One period of the field behind the modulator, (n,) complex64 of modulus 1, on a grid of `step_s`."""

    field: NDArray[np.complex64]
    step_s: float

    @property
    def period_s(self) -> float:
        """Period of the drive (s)."""
        return self.field.size * self.step_s

    @cached_property
    def spectrum(self) -> NDArray[np.complex64]:
        """Of the field, (n,)."""
        return np.asarray(np.fft.fft(self.field))


def idle_light(parameters: Parameters) -> DriveLight:
    """Light without a drive: unmodulated, so that one grid point describes it."""
    return DriveLight(np.ones(1, np.complex64), parameters.drive_step_s)


def driven_light(parameters: Parameters, volts: NDArray[np.float32], sample_rate: float) -> DriveLight:
    """Field behind the modulator for DAC `volts` (n,) at `sample_rate` S/s."""
    points = drive.oversampling(sample_rate, parameters.drive_step_s)
    step = 1.0 / (sample_rate * points)
    held = drive.held_and_filtered(
        volts, points_per_sample=points, sample_rate=sample_rate, bandwidth_hz=parameters.awg_bandwidth_hz
    )
    driven = drive.amplified(held, gain=parameters.rf_gain, saturation_v=parameters.rf_saturation_v)
    field = drive.phase_modulated_field(
        driven, v_pi=parameters.v_pi_v, bandwidth_hz=parameters.modulator_bandwidth_hz, step=step
    )
    return DriveLight(field, step)


def port_transmission(parameters: Parameters, port: int) -> float:
    """Power transmission of everything between laser and detector but the overlap with the collected mode and chip."""
    if parameters.light_path == "direct":
        common = power_ratio(-parameters.modulator_loss_db)
    else:
        common = parameters.projector_transmission * parameters.amplifier_gain
    return common * lead_transmission(parameters, port)


def lead_transmission(parameters: Parameters, port: int) -> float:
    """Power transmission from the chip's input fibre to the detector, the cavity itself left out."""
    if port == BYPASS:
        return power_ratio(-parameters.bypass_attenuation_db)
    return power_ratio(-parameters.spot_size_converter_loss_db - parameters.facet_loss_db)


def chip_transfer(
    parameters: Parameters, chip: cavity.Cavity, *, step_s: float, detuning_hz: float
) -> NDArray[np.complex128]:
    """Field transfer from the input waveguide to every port, (ports, F), FFT frequencies of a grid of `step_s`."""
    return cavity.transfer(
        chip,
        points=max(8 * _ACAUSAL_POINTS, round(CHIP_MEMORY_S / step_s)),
        step=step_s,
        detuning_hz=detuning_hz,
        loss_hz=1.0 / (2 * np.pi * parameters.chip_loss_lifetime_s),
        input_port=parameters.chip_input_port,
    )


def periodic_transfer(transfer: NDArray[np.complex128], points: int) -> NDArray[np.complex128]:
    """Resample (ports, F) transfer functions to the harmonics of a period of `points` grid points.

    The impulse response (a few hundred ps) is wrapped into the period: exact for a periodic drive of any length.
    """
    impulse = np.roll(np.fft.ifft(transfer, axis=-1), _ACAUSAL_POINTS, axis=-1)
    ports, length = impulse.shape
    padded = np.pad(impulse, ((0, 0), (0, -length % points)))
    wrapped = np.roll(padded.reshape(ports, -1, points).sum(axis=1), -_ACAUSAL_POINTS, axis=-1)
    return np.asarray(np.fft.fft(wrapped, axis=-1))


def port_fields(
    light: DriveLight, transfer: NDArray[np.complex128], amplitudes: Sequence[tuple[int, float]]
) -> NDArray[np.complex64]:
    """Modulated light g_m behind each (port, field amplitude): (channels, n) complex64, one period.

    Port `BYPASS` has S = 1; an amplitude of 0 gives a dark channel.
    """
    fields = np.zeros((len(amplitudes), light.field.size), np.complex64)
    behind_chip = [
        (channel, port, size) for channel, (port, size) in enumerate(amplitudes) if port != BYPASS and size > 0
    ]
    if behind_chip:
        response = periodic_transfer(transfer[[port - 1 for _, port, _ in behind_chip]], light.field.size)
        answers = np.fft.ifft(light.spectrum * response, axis=-1)
        for (channel, _, size), answer in zip(behind_chip, answers, strict=True):
            fields[channel] = size * answer
    for channel, (port, size) in enumerate(amplitudes):
        if port == BYPASS:
            fields[channel] = np.float32(size) * light.field
    return fields


def interpolation(position: NDArray[np.float64], points: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Four-point Lagrange interpolation on a periodic grid of `points`, at `position` in grid steps.

    Returns indices (4, n) and weights (4, n); positions within 1e-4 of a grid point take that point alone.
    """
    nearest = np.rint(position)
    position = np.where(np.abs(position - nearest) < 1e-4, nearest, position)
    base = np.floor(position)
    x = position - base
    index = np.mod(base.astype(np.int64)[None] + np.arange(-1, 3)[:, None], points)
    weight = np.stack(
        [
            -x * (x - 1) * (x - 2) / 6,
            (x + 1) * (x - 1) * (x - 2) / 2,
            -(x + 1) * x * (x - 2) / 2,
            (x + 1) * x * (x - 1) / 6,
        ]
    )
    return index.astype(np.intp), weight.astype(np.float32)


def delayed(
    fields: NDArray[np.complex64], depth: int, light_times: NDArray[np.float64], step_s: float
) -> NDArray[np.complex64]:
    """What the ports' light was at the given light times and `depth` delays before each: g_m(t - d dt).

    Args:
        fields: (channels, n) one period on a grid of `step_s`.
        depth: how many delays, of the fibre's taps.
        light_times: (K,) s, any order.
        step_s: grid step (s).

    Returns:
        (depth, channels * K) complex64: with it the light is a matrix product, for times that are not on a grid.
    """
    channels, points = fields.shape
    index, weight = interpolation(light_times / step_s, points)
    used = range(4) if np.any(weight[[0, 2, 3]]) else (1,)
    light = np.zeros((depth, channels, light_times.size), np.complex64)
    for corner in used:
        gathered = fields[:, (index[corner] - np.arange(depth)[:, None]) % points]
        light += (gathered * weight[corner]).transpose(1, 0, 2)
    return light.reshape(depth, -1)


def window_spectrum(
    fields: NDArray[np.complex64], depth: int, *, start: float, points: int, every: int
) -> NDArray[np.complex64]:
    """Transform of the ports' light around some light times, for `light_path.through_delays`.

    Args:
        fields: (channels, n) one period.
        depth: how many delays, of the fibre's taps.
        start: the first light time, in grid steps.
        points: how many light times.
        every: from one to the next, in grid steps.

    Returns:
        (channels, every, F) complex64.
    """
    period = fields.shape[1]
    index, weight = interpolation(np.array([start]), period)
    earlier, later = np.arange(1 - depth, 0), np.arange(every * (points - 1) + 1)
    frequencies = fft.next_fast_len(-(-(depth - 1 + later.size) // every))
    light = np.zeros((len(fields), every * frequencies), np.complex64)
    for corner in np.flatnonzero(weight[:, 0]):
        light[:, later] += fields[:, (index[corner] + later) % period] * weight[corner]
        light[:, earlier] += fields[:, (index[corner] + earlier) % period] * weight[corner]
    spectrum = fft.fft(light, axis=-1) / np.float32(every)
    return np.asarray(spectrum, np.complex64).reshape(len(fields), every, frequencies)


def mean_volts(
    amplitudes: NDArray[np.float32], fields: NDArray[np.complex64], taps: NDArray[np.complex64]
) -> NDArray[np.float64]:
    """Mean of the fast volts over the drive's period, (channels,): what an AC-coupled detector takes away.

    v^T Re(T R_m T^H) v with R_m[d, e] the periodic autocorrelation of g_m at lag e - d; amplitudes v (superpixels,).
    """
    points = fields.shape[1]
    depth = taps.shape[-1]
    lag = (np.arange(depth)[None, :] - np.arange(depth)[:, None]) % points
    projected = amplitudes @ taps
    correlations = np.fft.ifft(np.abs(np.fft.fft(fields, axis=1)) ** 2, axis=1) / points
    return np.array([np.sum(projected * (projected.conj() @ row[lag].T)).real for row in correlations])


def volts_per_field(parameters: Parameters, port: int, laser_power_w: float) -> float:
    """Volts per squared field, the field being a C of unit-power light through fibre and chip."""
    return laser_power_w * port_transmission(parameters, port) * parameters.detector_gain_v_per_w


def port_noise(
    parameters: Parameters, transfer: NDArray[np.complex128], port: int | None, step_s: float, *, scope_hz: float
) -> receiver.NoiseLaw:
    """Noise law of the detector on `port` behind `scope_hz`; None = nothing connected, or a port without light.

    The chip filters the amplifier's ASE with the same |S|^2 as the light, taken at its mean over the optical filter.
    """
    density = 0.0
    if port is not None and parameters.light_path == "projector":
        density = parameters.ase_density * lead_transmission(parameters, port)
        if port != BYPASS:
            band = np.abs(np.fft.fftfreq(transfer.shape[-1], step_s)) < parameters.amplifier_filter_hz / 2
            density *= float(np.mean(np.abs(transfer[port - 1, band]) ** 2))
    return receiver.noise_law(
        ase_density=density,
        ase_bandwidth_hz=parameters.amplifier_filter_hz,
        bandwidth_hz=receiver.noise_bandwidth(parameters.detector_bandwidth_hz, scope_hz),
        gain_v_per_w=parameters.detector_gain_v_per_w,
        responsivity=parameters.detector_responsivity_a_per_w,
        nep=parameters.detector_nep_w_per_rthz,
        rin_per_hz=power_ratio(parameters.laser_rin_db_per_hz),
    )


def power_factors(light: DriveLight, taps: NDArray[np.complex64]) -> NDArray[np.float32]:
    """What gives the mean power of the collected light for any mirrors v: |a|^2 = sum of (v L)^2, L (superpixels, q).

    The mean over the drive's period is v^T Re(T R T^H) v, R[d, e] the drive's periodic autocorrelation at lag e - d.
    R, each delay weighed with its share of the light, has few eigenvalues worth keeping: as many as the fibre's delays
    hold symbols. L = T F with R = F F^H.
    """
    points = light.field.size
    share = np.sqrt(np.mean(np.abs(taps) ** 2, axis=(0, 1), dtype=np.float64))
    delays = np.flatnonzero(share)  # of a long fibre some have no light
    taps, share = np.take(taps, delays, axis=-1), share[delays]
    correlation = np.fft.ifft(np.abs(light.spectrum) ** 2) / points
    lag = (delays[np.newaxis, :] - delays[:, np.newaxis]) % points
    power, vectors = np.linalg.eigh(share[:, np.newaxis] * correlation[lag] * share)
    kept = np.cumsum(power) > _POWER_LEFT_OUT * power.sum()
    spread = vectors[:, kept] * np.sqrt(power[kept]) / share[:, np.newaxis]
    factors = taps @ spread.astype(np.complex64)
    columns = np.concatenate([factors.real, factors.imag], axis=-1)
    return np.ascontiguousarray(np.concatenate(list(columns), axis=-1))


def projector(parameters: Parameters) -> fibre.Projector:
    """The optics around the mirrors."""
    return fibre.Projector(
        wavelength=parameters.design_wavelength_nm * 1e-9,
        core_radius=parameters.core_diameter_m / 2,
        aperture=parameters.fibre_na,
        index=parameters.fibre_index,
        group_index=parameters.fibre_group_index,
        length=parameters.fibre_length_m,
        launch_aperture=parameters.launch_na,
        launch_profile=parameters.launch_profile,
        side=parameters.image_side * parameters.core_diameter_m,
        collection_radius=parameters.collection_core_m / 2,
        collection_aperture=parameters.collection_na,
        collection_image=parameters.collection_image,
        collecting_modes=parameters.collecting_modes,
    )


def draw_fibre(parameters: Parameters, generator: np.random.Generator) -> fibre.FibreModes:
    """One fibre with its collection; the direct path is a fibre of one mode that all light takes."""
    if parameters.light_path == "direct":
        return fibre.single_mode()
    return fibre.draw_modes(
        generator,
        projector(parameters),
        collected_modes=parameters.collected_modes,
        coherence_s=parameters.fibre_coherence_s,
    )
