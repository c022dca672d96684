"""One twin: its fibre and its chips, drawn from a seed, and what the instruments' settings make of their light."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import cavity, chain, derived, drive, fibre, receiver
from sim_backends.optics.drift import OrnsteinUhlenbeck
from sim_backends.parameters import SPEED_OF_LIGHT, Parameters
from sim_backends.world.keyed_random import Purpose, digest, generator
from sim_backends.world.signals import BYPASS, Emission, OutOfMemory, Playback

_LEAD_S = 2e-9  # more than the band limits smear the start of a segment forward
_FILTERS_S = 1e-9  # more than generator, amplifier and modulator remember
_KEPT = 8  # of what a fibre that drifts leaves as it is
_KEPT_TWINS = 2
_MOST_POINTS = 2**24  # of a drive's light, some gigabytes: 84 us, four times the longest of a dynamic scene


@dataclass(frozen=True)
class Setting:
    """What the instruments fix before the mirrors come in.

    ports: the port whose light each recorded channel sees, None = none. drift_step: number of the virtual-time step.
    segment: of a triggered playback, the one that plays; None: it waits for its first trigger. repeats: how often the
    segment is played before the output idles again; 0: for ever, and has been. bandwidth_hz: of an `Acquisition`; it
    changes the receivers' noise alone, and is no part of `key`.
    """

    emission: Emission | None
    playback: Playback | None
    ports: tuple[int | None, ...]
    drift_step: int
    segment: int | None = None
    repeats: int = 1
    bandwidth_hz: float = math.inf

    @property
    def played(self) -> "Setting":
        """The part of it that the light behind the modulator depends on."""
        return Setting(None, self.playback, (), 0, self.segment, self.repeats)

    @property
    def periodic(self) -> bool:
        """Whether the light repeats for ever."""
        return self.playback is None or self.playback.lengths is None or self.segment is None or self.repeats == 0

    @property
    def key(self) -> bytes:
        """Names the setting."""
        laser = (self.emission.wavelength_nm, self.emission.power_w) if self.emission else ("dark",)
        played = self.playback.digest if self.playback else "idle"
        segment: tuple[Purpose, ...] = () if self.segment is None else ("segment", self.segment, self.repeats)
        return digest(*laser, played, *(str(port) for port in self.ports), self.drift_step, *segment)


@dataclass(frozen=True, eq=False)
class Optics:
    """What a setting fixes: fields (root volts) behind the ports on a grid of `step_s`, fibre taps, receiver noise.

    power_factors: of the mean power behind the preamplifier (see `chain.power_factors`), (superpixels, q), root W;
        none where there is no amplifier. laws: of the channels' receivers.
    idle_s: light idles from this long before the segment's start, and at the end of the fields; None: it is periodic.
    delay_s: from where a sample stands in the drive to its light at the detectors.
    """

    key: bytes
    fields: NDArray[np.complex64]
    taps: NDArray[np.complex64]
    step_s: float
    power_factors: NDArray[np.float32] | None
    laws: receiver.NoiseLaws
    lit: bool
    idle_s: float | None
    delay_s: float

    @cached_property
    def sending(self) -> NDArray[np.float32]:
        """The taps as (superpixels, modes * delays * real and imaginary): amplitudes times this are sent."""
        superpixels = self.taps.shape[1]
        return np.ascontiguousarray(self.taps.swapaxes(0, 1)).reshape(superpixels, -1).view(np.float32)

    def of_one(self, amplitudes: NDArray[np.float32]) -> "Optics":
        """The same for a single picture, mirrors of `amplitudes` (superpixels,) as one: cheap for a whole period."""
        factors = None if self.power_factors is None else amplitudes[np.newaxis] @ self.power_factors
        taps = np.einsum("p,mpd->md", amplitudes, self.taps)[:, np.newaxis]
        return replace(self, key=digest(self.key, amplitudes.tobytes()), taps=taps, power_factors=factors)


_Light = tuple[chain.DriveLight, float | None]
_Taps = tuple[NDArray[np.complex64], int]


class Twin:
    """A fibre, and a cavity a nanometre."""

    def __init__(self, parameters: Parameters, seed: int) -> None:
        self._parameters = parameters
        self._modes = chain.draw_fibre(parameters, _generator(seed, "fibre"))
        self._laser_wander, self._chip_wander = (
            OrnsteinUhlenbeck.draw(_generator(seed, what), np.array([math.sqrt(2) * rms_hz]), parameters.wander_time_s)
            for what, rms_hz in (
                ("laser wander", parameters.laser_wander_hz),
                ("chip wander", parameters.chip_wander_hz),
            )
        )
        # Not methods: a twin that refers to itself would stay in memory until somebody looks for such circles.
        self._chip = cache(partial(_drawn_chip, parameters, seed))
        self._light = lru_cache(_KEPT)(partial(_made_light, parameters, float(self._modes.delays_s.max())))
        self._transfer = lru_cache(_KEPT)(partial(_made_transfer, parameters, self._chip))
        self._fields = lru_cache(_KEPT)(partial(_made_fields, self._light, self._transfer))
        self._taps = lru_cache(_KEPT)(partial(_made_taps, self._modes))
        self._factors = lru_cache(_KEPT)(partial(_made_factors, self._light, self._taps))

    def optics(self, setting: Setting) -> Optics:
        """What `setting` fixes."""
        constants = self._parameters
        laser = setting.emission or Emission(constants.design_wavelength_nm, 0.0)
        light, idle_s = self._light(setting.played)
        frequency = SPEED_OF_LIGHT / (laser.wavelength_nm * 1e-9)
        time_s = setting.drift_step * constants.drift_step_s if setting.drift_step else 0.0
        frequency += float(self._laser_wander.at(time_s)[0].real)
        nearest_nm = round(laser.wavelength_nm)
        detuning = frequency - SPEED_OF_LIGHT / (nearest_nm * 1e-9)
        detuning -= float(self._chip_wander.at(time_s)[0].real)
        transfer = self._transfer(nearest_nm, light.step_s, detuning)
        wanted = tuple(
            (BYPASS, 0.0) if port is None else (port, math.sqrt(chain.volts_per_field(constants, port, laser.power_w)))
            for port in setting.ports
        )
        scope_hz = min(constants.scope_bandwidth_hz, setting.bandwidth_hz)
        laws = [chain.port_noise(constants, transfer, port, light.step_s, scope_hz=scope_hz) for port in setting.ports]
        taps, early = self._taps(frequency, light.step_s, time_s)
        factors = None
        if constants.light_path == "projector" and constants.amplifier_gain > 1 and setting.emission is not None:
            watts = laser.power_w * constants.projector_transmission * constants.amplifier_gain
            # A segment is taken as if it repeated for ever, for a slow amplifier's mean.
            mean = setting.played if setting.periodic else replace(setting.played, repeats=0)
            factors = np.float32(math.sqrt(watts)) * self._factors(mean, frequency, time_s)
        return Optics(
            setting.key,
            self._fields(setting.played, nearest_nm, detuning, wanted),
            taps,
            light.step_s,
            factors,
            receiver.NoiseLaws.of(laws),
            setting.emission is not None,
            idle_s,
            constants.light_delay_s + (setting.playback.skew_s if setting.playback else 0.0) - early * light.step_s,
        )


def _made_light(parameters: Parameters, longest_delay_s: float, setting: Setting) -> _Light:
    """Light behind the modulator and, unless it is periodic, how long it idles before the segment starts.

    After the segment it idles for longer than fibre and chip remember, so that the end of the field is the beginning.
    A segment is taken to start from idle light: the one before ended some 10 ns earlier at least.

    Raises:
        OutOfMemory: the drive is.
    """
    playback = setting.playback
    waiting = playback is not None and playback.lengths is not None and setting.segment is None
    if playback is None or waiting:
        return chain.idle_light(parameters), None
    rate = playback.sample_rate
    volts, _ = playback.segment(setting.segment or 0)
    step = 1.0 / (rate * drive.oversampling(rate, parameters.drive_step_s))
    if (lasts_s := volts.size * max(1, setting.repeats) / rate) > _MOST_POINTS * step:
        raise OutOfMemory(f"a drive of {lasts_s:.2g} s, {_MOST_POINTS * step:.2g} s are the most that are simulated")
    if setting.periodic:
        return chain.driven_light(parameters, volts, rate), None
    remembered = chain.CHIP_MEMORY_S + longest_delay_s + _FILTERS_S
    lead, tail = math.ceil(_LEAD_S * rate), math.ceil(remembered * rate)
    volts = np.concatenate([np.zeros(lead, np.float32), np.tile(volts, setting.repeats), np.zeros(tail, np.float32)])
    return chain.driven_light(parameters, volts, rate), lead / rate


def _drawn_chip(parameters: Parameters, seed: int, wavelength_nm: int) -> cavity.Cavity:
    """One independent cavity a nanometre (125 GHz, many linewidths); small detunings shift the same one."""
    return cavity.draw_cavity(
        _generator(seed, "chip", wavelength_nm),
        modes=parameters.chip_modes,
        density=derived.mode_density_per_hz(parameters),
        ports=parameters.chip_ports,
        transmission=parameters.chip_coupling,
    )


def _made_transfer(
    parameters: Parameters, chip: Callable[[int], cavity.Cavity], nearest_nm: int, step_s: float, detuning_hz: float
) -> NDArray[np.complex128]:
    """Of the chip at a nanometre, by so much beside it."""
    return chain.chip_transfer(parameters, chip(nearest_nm), step_s=step_s, detuning_hz=detuning_hz)


def _made_fields(
    lights: Callable[[Setting], _Light],
    transfer: Callable[[int, float, float], NDArray[np.complex128]],
    played: Setting,
    nearest_nm: int,
    detuning_hz: float,
    wanted: tuple[tuple[int, float], ...],
) -> NDArray[np.complex64]:
    """Behind the wanted ports (port, amplitude)."""
    light, _ = lights(played)
    return chain.port_fields(light, transfer(nearest_nm, light.step_s, detuning_hz), wanted)


def _made_taps(modes: fibre.FibreModes, frequency_hz: float, step_s: float, time_s: float) -> _Taps:
    """Of the fibre, and how many come before the one without delay."""
    return fibre.delay_taps(modes, frequency_hz=frequency_hz, step=step_s, time_s=time_s)


def _made_factors(
    lights: Callable[[Setting], _Light],
    taps: Callable[[float, float, float], _Taps],
    played: Setting,
    frequency_hz: float,
    time_s: float,
) -> NDArray[np.float32]:
    """Of the mean power, for light that a watt was launched with."""
    light, _ = lights(played)
    return chain.power_factors(light, taps(frequency_hz, light.step_s, time_s)[0])


def _generator(seed: int, *purpose: str | int) -> np.random.Generator:
    return generator(digest(seed, *purpose))


@lru_cache(_KEPT_TWINS)
def drawn_twin(parameters: Parameters, seed: int) -> Twin:
    """The twin of this seed; it is the same whenever it is drawn, and the latest ones are kept."""
    return Twin(parameters, seed)
