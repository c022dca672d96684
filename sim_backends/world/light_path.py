"""One twin's fibre and chip, and what the settings of the instruments make of them, computed once and kept.

Keeps the draws (fibre, one cavity a nanometre) and small caches of what a setting fixes: fields behind the ports,
masks at the sampled times, sampling filters. Knows no mirrors' history, no triggers, no noise.
"""

import math
from collections import OrderedDict
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import cavity, chain, derived, drive, fibre, mirrors, receiver
from sim_backends.parameters import SPEED_OF_LIGHT, Parameters
from sim_backends.world.keyed_random import Purpose, digest, generator
from sim_backends.world.signals import BYPASS, Acquisition, Emission, Playback

_KEPT_SETTINGS = 12
_KEPT_MASK_BYTES = 300_000_000
_PAGE_POINTS = 4096
_BLOCK_SAMPLES = 64
_LEAD_S = 2e-9  # more than the band limits smear the start of a segment forward
_FILTERS_S = 1e-9  # more than generator, amplifier and modulator remember

sampling_filter = lru_cache(maxsize=64)(receiver.sampling_filter)


@dataclass(frozen=True, eq=False)
class Setting:
    """What the instruments fix before the mirrors come in.

    ports: the port whose light each recorded channel sees, None = none. wander_step: number of the virtual-time step.
    segment: of a triggered playback, the one that plays; None: it waits for its first trigger. repeats: how often the
    segment is played before the output idles again; 0: for ever, and has been.
    """

    emission: Emission | None
    playback: Playback | None
    ports: tuple[int | None, ...]
    wander_step: int
    segment: int | None = None
    repeats: int = 1

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
        return digest(*laser, played, *(str(port) for port in self.ports), self.wander_step, *segment)


@dataclass(frozen=True, eq=False)
class Optics:
    """What a setting fixes: fields (root volts) behind the ports on a grid of `step_s`, fibre taps, receiver noise.

    laws: (4, channels, 1) float32, rows of `receiver.NoiseLaw`: floor, linear, quadratic, offset.
    idle_s: light idles from this long before the segment's start, and at the end of the fields; None: it is periodic.
    """

    key: bytes
    fields: NDArray[np.complex64]
    taps: NDArray[np.complex64]
    step_s: float
    laws: NDArray[np.float32]
    lit: bool
    idle_s: float | None


class LightPath:
    """Laser to detector input of one twin: `Parameters` and a seed."""

    def __init__(self, parameters: Parameters, twin_seed: int) -> None:
        self._parameters = parameters
        self._seed = twin_seed
        self._chips: dict[int, cavity.Cavity] = {}
        self._optics: OrderedDict[bytes, Optics] = OrderedDict()
        self._masks: OrderedDict[bytes, NDArray[np.float32]] = OrderedDict()
        self._basis, self._modes = chain.draw_fibre(parameters, self._generator("fibre"))

    def amplitudes(self, on: NDArray[np.float32]) -> NDArray[np.float32]:
        """Mirror patterns, on-fractions (images, 784), in the speckle basis: (images, r)."""
        if self._parameters.light_path == "direct":
            return np.ones((on.shape[0], 1), np.float32)
        return chain.speckle_amplitudes(self._basis, on)

    def optics(self, setting: Setting) -> Optics:
        """What `setting` fixes; from the cache if it was there before."""
        key = setting.key
        if key in self._optics:
            self._optics.move_to_end(key)
        else:
            self._optics[key] = self._new_optics(setting)
            if len(self._optics) > _KEPT_SETTINGS:
                self._optics.popitem(last=False)
        return self._optics[key]

    def sampled(
        self,
        optics: Optics,
        acquisition: Acquisition,
        amplitudes: NDArray[np.float32],
        *,
        phase_s: float,
        shift_s: float,
        before: NDArray[np.float32] | None = None,
        moving_since_s: float = 0.0,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Noise-free volts after a trigger and their slopes (V/s), (images, channels, samples) each.

        Args:
            optics: what the setting fixes.
            acquisition: when to sample.
            amplitudes: (images, r) mirrors, each of them by itself.
            phase_s: trigger's phase in the drive's period, or time from the segment's start to the trigger.
            shift_s: samples are taken this much later than the acquisition says.
            before: (images, r) where the mirrors come from; None = they stand still.
            moving_since_s: time from the mirrors' last change to the trigger.
        """
        constants = self._parameters
        decimation = math.ceil(1.0 / (acquisition.sample_rate * constants.record_step_s) - 1e-9)
        step = 1.0 / (acquisition.sample_rate * decimation)
        sampling = sampling_filter(
            samples=min(acquisition.samples, _BLOCK_SAMPLES),
            decimation=decimation,
            step=step,
            shift_s=shift_s,
            detector_hz=constants.detector_bandwidth_hz,
            scope_hz=constants.scope_bandwidth_hz,
        )
        if not optics.lit:
            zero = np.zeros((len(amplitudes), len(optics.fields), acquisition.samples), np.float32)
            return zero, zero
        points = sampling.points + (acquisition.samples - sampling.samples) * decimation
        first = acquisition.start_s - sampling.before * step
        light_time = phase_s + first - constants.light_delay_s
        field = self._field(optics, amplitudes, light_time, step, points)
        if before is not None:
            moved = mirrors.moved_fraction(
                moving_since_s + first + step * np.arange(points, dtype=np.float64),
                leaves=constants.mirror_leaves_s,
                arrives=constants.mirror_arrives_s,
            ).astype(np.float32)
            old = self._field(optics, before, light_time, step, points)
            field = old + moved * (field - old)
        clean, slope = receiver.apply_filter(sampling, chain.fast_volts(field), acquisition.samples)
        if constants.detector_coupling == "ac":
            clean = clean - self._mean_volts(optics, amplitudes)
        return clean, slope

    def _mean_volts(self, optics: Optics, amplitudes: NDArray[np.float32]) -> NDArray[np.float32]:
        """What an AC-coupled detector takes away, (images, channels, 1): behind a triggered drive, the idle light."""
        if optics.idle_s is not None:
            return chain.fast_volts(self._inside(optics, amplitudes, 0.0, optics.step_s, 1))
        means = [chain.mean_volts(row, optics.fields, optics.taps) for row in amplitudes]
        return np.array(means, np.float32)[:, :, None]

    def _field(
        self, optics: Optics, amplitudes: NDArray[np.float32], start_s: float, step: float, points: int
    ) -> NDArray[np.float32]:
        """Root volts (images, real and imaginary, collected modes, channels, points) at equidistant light times.

        A record longer than the drive's period is interpolated from one period. Before and after a triggered segment
        the light stands still.
        """
        period = optics.fields.shape[1] * optics.step_s
        if optics.idle_s is not None:
            start_s += optics.idle_s
            begin = min(max(0, math.ceil(-start_s / step)), points - 1)
            end = max(begin + 1, min(points, math.ceil((period - start_s) / step)))
            inside = min(max(start_s + begin * step, 0.0), period)  # all of it outside: the idle light of either end
            moving = self._inside(optics, amplitudes, inside, step, end - begin)
            idle = self._inside(optics, amplitudes, 0.0, optics.step_s, 1)
            shape = moving.shape[:-1]
            return np.concatenate(
                [
                    np.broadcast_to(idle, (*shape, begin)),
                    moving,
                    np.broadcast_to(idle, (*shape, points - end)),
                ],
                axis=-1,
            )
        in_period = max(1, math.ceil(period / self._parameters.record_step_s - 1e-6))
        if optics.fields.shape[1] == 1:
            in_period = 1
        if points <= in_period:
            return self._inside(optics, amplitudes, start_s, step, points)
        table = self._inside(optics, amplitudes, start_s, period / in_period, in_period)
        index, weight = chain.interpolation(np.arange(points) * (step * in_period / period), in_period)
        field: NDArray[np.float32] = table[..., index[1]] * weight[1]
        if np.any(weight[[0, 2, 3]]):
            for corner in (0, 2, 3):
                field += table[..., index[corner]] * weight[corner]
        return field

    def _inside(
        self, optics: Optics, amplitudes: NDArray[np.float32], start_s: float, step: float, points: int
    ) -> NDArray[np.float32]:
        """Root volts at light times within one period, page by page."""
        shape = (len(amplitudes), 2, optics.taps.shape[0], len(optics.fields), -1)
        pages = []
        for begin in range(0, points, _PAGE_POINTS):
            page = self._page(optics, start_s + begin * step, step, min(points - begin, _PAGE_POINTS))
            pages.append(chain.in_blocks(amplitudes, page).reshape(shape))
        return pages[0] if len(pages) == 1 else np.concatenate(pages, axis=-1)

    def _page(self, optics: Optics, start_s: float, step: float, points: int) -> NDArray[np.float32]:
        """Masks at `points` light times from `start_s`, kept while there is room."""
        key = digest(optics.key, start_s, step, points)
        if key in self._masks:
            self._masks.move_to_end(key)
            return self._masks[key]
        page = chain.masks(
            optics.fields, optics.taps, start_s + step * np.arange(points, dtype=np.float64), optics.step_s
        )
        self._masks[key] = page
        while sum(kept.nbytes for kept in self._masks.values()) > _KEPT_MASK_BYTES and len(self._masks) > 1:
            self._masks.popitem(last=False)
        return page

    def _new_optics(self, setting: Setting) -> Optics:
        constants = self._parameters
        laser = setting.emission or Emission(constants.design_wavelength_nm, 0.0)
        light, idle_s = self._light(setting)
        frequency = SPEED_OF_LIGHT / (laser.wavelength_nm * 1e-9)
        frequency += self._detuning("laser wander", constants.laser_wander_hz, setting.wander_step)
        nearest_nm = round(laser.wavelength_nm)
        detuning = frequency - SPEED_OF_LIGHT / (nearest_nm * 1e-9)
        detuning -= self._detuning("chip wander", constants.chip_wander_hz, setting.wander_step)
        transfer = chain.chip_transfer(constants, self._chip(nearest_nm), step_s=light.step_s, detuning_hz=detuning)
        wanted = [
            (BYPASS, 0.0) if port is None else (port, math.sqrt(chain.volts_per_field(constants, port, laser.power_w)))
            for port in setting.ports
        ]
        laws = [chain.port_noise(constants, transfer, port, light.step_s) for port in setting.ports]
        return Optics(
            setting.key,
            chain.port_fields(light, transfer, wanted),
            fibre.delay_taps(self._modes, frequency_hz=frequency, step=light.step_s),
            light.step_s,
            np.array([[law.floor, law.linear, law.quadratic, law.offset_v] for law in laws], np.float32).T[:, :, None],
            setting.emission is not None,
            idle_s,
        )

    def _light(self, setting: Setting) -> tuple[chain.DriveLight, float | None]:
        """Light behind the modulator and, unless it is periodic, how long it idles before the segment starts.

        After the segment it idles for longer than fibre and chip remember, so that the end of the field is the
        beginning. A segment is taken to start from idle light: the one before ended some 10 ns earlier at least.
        """
        constants, playback = self._parameters, setting.playback
        waiting = playback is not None and playback.lengths is not None and setting.segment is None
        if playback is None or waiting:
            return chain.idle_light(constants), None
        rate = playback.sample_rate
        volts, _ = playback.segment(setting.segment or 0)
        if setting.periodic:
            return chain.driven_light(constants, volts, rate), None
        step = 1.0 / (rate * drive.oversampling(rate, constants.drive_step_s))
        remembered = chain.IMPULSE_POINTS * step + float(self._modes.delays_s.max()) + _FILTERS_S
        lead, tail = math.ceil(_LEAD_S * rate), math.ceil(remembered * rate)
        volts = np.concatenate(
            [np.zeros(lead, np.float32), np.tile(volts, setting.repeats), np.zeros(tail, np.float32)]
        )
        return chain.driven_light(constants, volts, rate), lead / rate

    def _chip(self, wavelength_nm: int) -> cavity.Cavity:
        """One independent cavity a nanometre (125 GHz, many linewidths); small detunings shift the same one."""
        if wavelength_nm not in self._chips:
            constants = self._parameters
            self._chips[wavelength_nm] = cavity.draw_cavity(
                self._generator("chip", wavelength_nm),
                modes=constants.chip_modes,
                density=derived.mode_density_per_hz(constants),
                ports=constants.chip_ports,
                transmission=constants.chip_coupling,
            )
        return self._chips[wavelength_nm]

    def _detuning(self, what: str, rms_hz: float, step: int) -> float:
        return rms_hz * float(self._generator(what, step).standard_normal()) if rms_hz else 0.0

    def _generator(self, *purpose: str | int) -> np.random.Generator:
        return generator(digest(self._seed, *purpose))
