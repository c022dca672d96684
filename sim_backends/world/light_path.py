"""What noiseless detectors put out under a setting of the instruments: the light of every picture.

Keeps small caches of what a setting fixes: fields behind the ports, their spectra around the sampled times, sampling
filters. A picture then costs a real matrix product, a convolution and the detector's filter. Knows no mirrors' history
and no triggers.
"""

import math
from collections import OrderedDict
from functools import lru_cache
from threading import Lock
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from sim_backends.optics import chain, mirrors, receiver
from sim_backends.parameters import Parameters
from sim_backends.world.signals import Acquisition, OutOfMemory
from sim_backends.world.triggers import level_crossings
from sim_backends.world.twin import Optics, Setting, drawn_twin

IMAGE_BLOCK = 4
COLUMN_BLOCK = 256
_KEPT_SETTINGS = 12
_KEPT_BYTES = 50_000_000  # of pages: spectra, or matrices
_PAGE_POINTS = 2**14
_MOST_POINTS = 2**25
"""Of a record's light, some gigabytes: more than the longest record of the oscilloscopes at 100 GS/s, 0.3 ms, has."""
_OFF_GRID = 1e-4  # grid steps: light times that are no further beside the grid are on it
_BLOCK_SAMPLES = 16
_PHASE_STEP_S = 1.25e-12
_SAME_PHASE_S = 15e-12

sampling_filter = lru_cache(maxsize=64)(receiver.sampling_filter)


class Light(NamedTuple):
    """What triggers have in common that one computation serves: all but the pattern.

    step, segment (-1: none), repeats, lit: of their `Setting`. phase_s: in the drive's period, or time from the
    segment's start to the trigger. shift_s: samples are taken this much later than the acquisition says. scene: of the
    mirrors. age_s: from the mirrors' last change to the trigger; infinite: they stand still.
    """

    step: int
    segment: int
    repeats: int
    phase_s: float
    shift_s: float
    scene: int
    age_s: float
    lit: bool


class Grid(NamedTuple):
    """Where a record's intensities are computed: `points` of them, `step_s` apart, from `first_s` after the trigger."""

    sampling: receiver.SamplingFilter
    step_s: float
    points: int
    first_s: float


class LightPath:
    """Laser to detector of one twin: `Parameters` and a seed.

    Attributes:
        optics: what a `Setting` fixes; the latest ones are kept.
    """

    def __init__(self, parameters: Parameters, twin_seed: int) -> None:
        twin = drawn_twin(parameters, twin_seed)
        self.optics = lru_cache(_KEPT_SETTINGS)(twin.optics)
        self._parameters = parameters
        self._pages: OrderedDict[tuple[bytes, float, float, int], NDArray[np.complex64]] = OrderedDict()
        self._paging = Lock()

    def amplitudes(self, on: NDArray[np.float32]) -> NDArray[np.float32]:
        """What superpixels reflect, (images, 784), with these parts of their mirrors on; direct: all, (images, 1)."""
        if self._parameters.light_path == "direct":
            return np.ones((on.shape[0], 1), np.float32)
        return mirrors.reflected(on, self._parameters.mirror_contrast)

    def grid(self, acquisition: Acquisition, shift_s: float) -> Grid:
        """The times at which the light's intensity is wanted, and the filter that makes samples of it.

        Raises:
            OutOfMemory: there are too many of them.
        """
        constants = self._parameters
        decimation = math.ceil(1.0 / (acquisition.sample_rate * constants.record_step_s) - 1e-9)
        step = 1.0 / (acquisition.sample_rate * decimation)
        if acquisition.samples * decimation > _MOST_POINTS:
            lasts_s = acquisition.samples / acquisition.sample_rate
            raise OutOfMemory(f"{lasts_s:.2g} s of light, {_MOST_POINTS * step:.2g} s are the most that are simulated")
        sampling = sampling_filter(
            samples=min(acquisition.samples, _BLOCK_SAMPLES),
            decimation=decimation,
            step=step,
            shift_s=shift_s,
            detector_hz=constants.detector_bandwidth_hz,
            scope_hz=min(constants.scope_bandwidth_hz, acquisition.bandwidth_hz),
        )
        points = sampling.points + (acquisition.samples - sampling.samples) * decimation
        return Grid(sampling, step, points, acquisition.start_s - sampling.before * step)

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
        """Noise-free volts of the light after a trigger and their slopes (V/s), (images, channels, samples) each.

        The receivers' noise depends on these; a trace has `level` in addition.

        Args:
            optics: what the setting fixes.
            acquisition: when to sample.
            amplitudes: (images, superpixels) mirrors, each of them by itself.
            phase_s: trigger's phase in the drive's period, or time from the segment's start to the trigger.
            shift_s: samples are taken this much later than the acquisition says.
            before: (images, superpixels) where the mirrors come from; None = they stand still.
            moving_since_s: time from the mirrors' last change to the trigger.
        """
        constants = self._parameters
        sampling, step, points, first = self.grid(acquisition, shift_s)
        if not optics.lit:
            zero = np.zeros((len(amplitudes), len(optics.fields), acquisition.samples), np.float32)
            return zero, zero
        light_time = phase_s + first - optics.delay_s
        sent = _sent(optics, amplitudes)
        field = self._field(optics, sent, light_time, step, points)
        if before is not None:
            moved = mirrors.moved_fraction(
                moving_since_s + first + step * np.arange(points, dtype=np.float64),
                leaves=constants.mirror_leaves_s,
                arrives=constants.mirror_arrives_s,
            ).astype(np.float32)
            old = self._field(optics, _sent(optics, before), light_time, step, points)
            field = old + moved * (field - old)
        clean, slope = receiver.apply_filter(sampling, receiver.fast_volts(field), acquisition.samples)
        settled = amplitudes if before is None else before  # nothing slower than the mirrors has followed them yet
        clean, slope = self._preamplified(optics, settled, clean, slope)
        return clean, slope

    def level(self, optics: Optics, settled: NDArray[np.float32]) -> NDArray[np.float32]:
        """What a trace has beside its light (V), (channels, 1): the mean of the amplifier's own light.

        Behind AC coupling that is away, and the mean of the light as well: (images, channels, 1), negative.
        """
        if self._parameters.detector_coupling == "dc":
            return optics.laws.offset_v
        (mean,) = self._preamplified(optics, settled, self.mean_volts(optics, settled))
        return -mean

    def _preamplified(
        self, optics: Optics, settled: NDArray[np.float32], *volts: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], ...]:
        """Volts (images, ...) at the preamplifier's gain instead of its small-signal gain; without one, as they are."""
        if optics.power_factors is None:
            return volts
        watts = np.square(in_blocks(settled, optics.power_factors)).sum(axis=1)
        gain = receiver.saturated_gain(watts, self._parameters.amplifier_saturation_w)[:, np.newaxis, np.newaxis]
        return tuple(one * gain for one in volts)

    def crossings(
        self, setting: Setting, amplitudes: NDArray[np.float32], level_v: float, *, rising: bool
    ) -> NDArray[np.float64]:
        """Phases (s) of the drive's period at which the light on the setting's only port crosses a level."""
        if setting.playback is None:
            return np.empty(0)
        points = math.ceil(setting.playback.period / self._parameters.record_step_s)
        period = Acquisition((1,), points / setting.playback.period, points, 0.0)
        optics = self.optics(setting).of_one(amplitudes)
        whole = np.ones((1, 1), np.float32)
        clean, _ = self.sampled(optics, period, whole, phase_s=0.0, shift_s=0.0)
        trace = receiver.limited(clean + self.level(optics, whole), self._parameters.detector_limit_v)[0, 0]
        return level_crossings(trace, level_v, rising=rising) / period.sample_rate

    def mean_volts(self, optics: Optics, amplitudes: NDArray[np.float32]) -> NDArray[np.float32]:
        """Mean light (V) at small-signal gain, (images, channels, 1): behind a triggered drive, the idle light."""
        if optics.idle_s is not None:
            return receiver.fast_volts(self._inside(optics, _sent(optics, amplitudes), 0.0, optics.step_s, 1))
        means = [chain.mean_volts(row, optics.fields, optics.taps) for row in amplitudes]
        return np.array(means, np.float32)[:, :, None]

    def _field(
        self, optics: Optics, sent: NDArray[np.complex64], start_s: float, step: float, points: int
    ) -> NDArray[np.complex64]:
        """Root volts (images, collected modes, channels, points) at equidistant light times.

        A record longer than the drive's period is interpolated from one period. Before and after a triggered segment
        the light does not change.
        """
        period = optics.fields.shape[1] * optics.step_s
        if optics.idle_s is not None:
            start_s += optics.idle_s
            begin = min(max(0, math.ceil(-start_s / step)), points - 1)
            end = max(begin + 1, min(points, math.ceil((period - start_s) / step)))
            inside = min(max(start_s + begin * step, 0.0), period)  # all of it outside: the idle light of either end
            moving = self._inside(optics, sent, inside, step, end - begin)
            if end - begin == points:
                return moving
            idle = self._inside(optics, sent, 0.0, optics.step_s, 1)
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
            return self._inside(optics, sent, start_s, step, points)
        every = step * in_period / period
        if _on_grid(every, points):
            table = self._inside(optics, sent, start_s, period / in_period, in_period)
            field: NDArray[np.complex64] = np.take(table, np.arange(points) * round(every) % in_period, axis=-1)
            return field
        in_period = optics.fields.shape[1]  # on the fields' own grid, so that nothing is interpolated twice
        table = self._inside(optics, sent, 0.0, optics.step_s, in_period)
        times = start_s + step * np.arange(points, dtype=np.float64)
        index, weight = chain.interpolation(times / optics.step_s, in_period)
        field = table[..., index[1]] * weight[1]
        for corner in (0, 2, 3):
            field += table[..., index[corner]] * weight[corner]
        return field

    def _inside(
        self, optics: Optics, sent: NDArray[np.complex64], start_s: float, step: float, points: int
    ) -> NDArray[np.complex64]:
        """Root volts at light times within one period, page by page."""
        every = step / optics.step_s
        on_grid = _on_grid(every, points)
        pages = []
        for begin in range(0, points, _PAGE_POINTS):
            count = min(points - begin, _PAGE_POINTS)
            page = self._page(optics, start_s + begin * step, step, count, round(every) if on_grid else None)
            if on_grid:
                pages.append(through_delays(sent, page, count))
            else:
                shape = (*sent.shape[:2], len(optics.fields), count)
                pages.append(in_blocks(sent.reshape(-1, sent.shape[-1]), page).reshape(shape))
        return pages[0] if len(pages) == 1 else np.concatenate(pages, axis=-1)

    def _page(
        self, optics: Optics, start_s: float, step: float, points: int, every: int | None
    ) -> NDArray[np.complex64]:
        """The ports' light at `points` light times from `start_s` and delays before them, kept while there is room.

        Its spectrum where times are on the grid of the fields, each so many of its steps after the one before;
        otherwise a matrix.
        """
        key = (optics.key, start_s, step, points)
        with self._paging:  # what another thread is making is waited for
            if key in self._pages:
                self._pages.move_to_end(key)
                return self._pages[key]
            depth = optics.taps.shape[-1]
            if every is None:
                times = start_s + step * np.arange(points, dtype=np.float64)
                page = chain.delayed(optics.fields, depth, times, optics.step_s)
            else:
                start = start_s / optics.step_s
                page = chain.window_spectrum(optics.fields, depth, start=start, points=points, every=every)
            self._pages[key] = page
            while sum(kept.nbytes for kept in self._pages.values()) > _KEPT_BYTES and len(self._pages) > 1:
                self._pages.popitem(last=False)
            return page


def snapped(phases: NDArray[np.float64], period: float, marks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phases (s) of light on a fine grid, or on `marks`, the edges that triggers come from, where they are near one."""
    on_grid = np.rint(phases / _PHASE_STEP_S) * _PHASE_STEP_S
    if marks.size == 0:
        return on_grid
    away = np.abs(phases[:, None] - marks)
    if math.isfinite(period):
        away = np.minimum(away, period - away)
    nearest = away.argmin(axis=1)
    close = away[np.arange(phases.size), nearest] < _SAME_PHASE_S
    return np.where(close, marks[nearest], on_grid)


def _on_grid(every: float, points: int) -> bool:
    """Whether `points` times, `every` grid steps apart, are on the grid if the first one is."""
    return every > 0.5 and abs(every - round(every)) * points < _OFF_GRID


def _sent(optics: Optics, amplitudes: NDArray[np.float32]) -> NDArray[np.complex64]:
    """What pictures (n, superpixels) send through each delay of each mode, (n, modes, delays)."""
    sent = in_blocks(amplitudes, optics.sending).view(np.complex64)
    return sent.reshape(len(amplitudes), optics.taps.shape[0], -1)


def through_delays(sent: NDArray[np.complex64], spectrum: NDArray[np.complex64], points: int) -> NDArray[np.complex64]:
    """What arrives behind the ports, sum_d a_d g_m(t - d dt), at equidistant light times.

    A convolution by its Fourier transform; of the result only every so-manyth point is wanted, so that its spectrum is
    folded before it is transformed back.

    Args:
        sent: (images, modes, delays) a, what pictures send through each delay: amplitudes times taps.
        spectrum: (channels, every, F), of `chain.window_spectrum`.
        points: how many.

    Returns:
        (images, modes, channels, points) complex64.
    """
    _, every, frequencies = spectrum.shape
    each = fft.fft(sent, every * frequencies, axis=-1).reshape(*sent.shape[:2], 1, every, frequencies)
    folded = each[..., 0, :] * spectrum[:, 0]
    for part in range(1, every):
        folded += each[..., part, :] * spectrum[:, part]
    field: NDArray[np.complex64] = fft.ifft(folded, axis=-1, overwrite_x=True)[..., :points]
    return field


Numbers = TypeVar("Numbers", np.float32, np.complex64)


def in_blocks(rows: NDArray[Numbers], matrix: NDArray[Numbers]) -> NDArray[Numbers]:
    """Product rows @ matrix in blocks of `IMAGE_BLOCK` rows, zero-padded, by `COLUMN_BLOCK` columns.

    Every block has the same shape, so how many rows there are cannot change a byte of one. It is of a size that BLAS
    multiplies where it stands: a single picture does not wait until the masks are copied.
    """
    images, whole = len(rows), len(rows) // IMAGE_BLOCK * IMAGE_BLOCK
    out = np.empty((images, matrix.shape[1]), rows.dtype)
    tail = np.zeros((IMAGE_BLOCK, rows.shape[1]), rows.dtype)
    products = np.empty((IMAGE_BLOCK, matrix.shape[1]), rows.dtype)
    tail[: images - whole] = rows[whole:]
    blocks = rows[:whole].reshape(-1, IMAGE_BLOCK, rows.shape[1])
    for left in range(0, matrix.shape[1], COLUMN_BLOCK):
        block = slice(left, left + COLUMN_BLOCK)
        columns, place = matrix[:, block], out[:whole, block]
        np.matmul(blocks, columns, out=place.reshape(-1, IMAGE_BLOCK, place.shape[1]))
        if whole < images:
            np.matmul(tail, columns, out=products[:, block])
    out[whole:] = products[: images - whole]
    return out
