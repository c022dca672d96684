"""The receivers on a graphics card: the light of a block of pictures, its noise and its codes, by torch.

The same equations as `light_path` and `receivers`, in an order that suits a card: the light of a record is two matrix
products, mirrors with the fibre's taps and these with the drive's field at every time and delay, instead of a
convolution. What a setting fixes is computed by the program and kept on the card. Noise is a stream of the card's own:
records are not equal to the processor's, but alike, and depend on how many triggers are computed together.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from sim_backends.optics import chain, mirrors
from sim_backends.optics.receiver import digitiser_levels
from sim_backends.parameters import Parameters
from sim_backends.world.keyed_random import digest, generator
from sim_backends.world.light_path import Grid, Light, LightPath
from sim_backends.world.receivers import Alike, CardFull, Codes, Drawn, FrontEnd, colour_of, jitter_s
from sim_backends.world.signals import Acquisition
from sim_backends.world.twin import Optics, Setting

_AT_ONCE_BYTES = 500_000_000  # of fields computed together
_PAGE_POINTS = 4096  # times of a page of fields at every delay, of about 100 MB
_KEPT_SETTINGS = 12
_KEPT_PAGES = 4


@contextmanager
def _in_its_room() -> Iterator[None]:
    """Where the card has no room, that is the error.

    Raises:
        CardFull: so it is.
    """
    try:
        yield
    except torch.OutOfMemoryError:
        raise CardFull from None


class Placed(NamedTuple):
    """What a setting fixes, on the card: see `Optics`, of which `host` is the program's own."""

    setting: Setting
    host: Optics
    sending: Tensor
    fields: Tensor
    power_factors: Tensor | None
    floor: Tensor
    linear: Tensor
    quadratic: Tensor


class CardReceivers:
    """`Receivers` on the device of torch that `place` names."""

    def __init__(self, light_path: LightPath, parameters: Parameters, place: str = "cuda") -> None:
        self._light_path = light_path
        self._parameters = parameters
        self._place = torch.device(place)
        # Not methods: what refers to itself would keep its pages on the card until somebody looks for such circles.
        self._put = partial(_put, self._place)
        self._optics = lru_cache(_KEPT_SETTINGS)(partial(_placed, light_path, self._put))
        self._page = lru_cache(_KEPT_PAGES)(partial(_made_page, self._optics, self._place))

    def drawn(self, keys: Sequence[bytes], acquisition: Acquisition) -> Drawn:
        """See `Receivers`; white noise is the generator that it will come from."""
        source, count = generator(keys[0]), len(keys)
        lateness, offsets = source.standard_normal(count) * jitter_s(self._parameters), np.zeros(count)
        if not self._parameters.shared_reference:
            offsets = (source.random(count) - 0.5) / acquisition.sample_rate
        return Drawn(self._seeded(keys[0]), lateness, offsets)

    def white(self, keys: Sequence[bytes], acquisition: Acquisition) -> torch.Generator:
        """See `Receivers`."""
        return self._seeded(digest(keys[0], *acquisition.channels))

    @_in_its_room()
    def detect(self, white: torch.Generator, alike: Alike, volts: NDArray[np.float32]) -> None:
        """See `Receivers`."""
        rows, lateness, acquisition, setting, light, sight = alike
        optics, grid = self._optics(setting), self._light_path.grid(acquisition, light.shift_s)
        amplitudes, colour = sight.scenes[light.scene].amplitudes, colour_of(self._parameters, acquisition)
        modes, _, depth = optics.host.taps.shape
        windows = -(-acquisition.samples // grid.sampling.samples) * grid.sampling.points  # of a filter, overlapping
        channels = len(acquisition.channels)
        picture = 8 * modes * (channels * grid.points + depth) + 4 * channels * windows
        at_once = max(1, _AT_ONCE_BYTES // picture)
        for begin in range(0, len(rows), at_once):
            own = rows[begin : begin + at_once]
            before = amplitudes[sight.before[own]] if math.isfinite(light.age_s) else None
            after = amplitudes[sight.after[own]]
            clean, slope = self._sampled(optics, acquisition, grid, light, after, before)
            level = self._put(self._light_path.level(optics.host, after if before is None else before))
            late = self._put(lateness[own].astype(np.float32))[:, None, None]
            traces = self._noisy(optics, clean, white, colour) + level + late * slope
            limit = self._parameters.detector_limit_v
            volts[own] = (traces / (1 + (traces / limit) ** 6) ** (1 / 6)).cpu().numpy()

    @_in_its_room()
    def digitised(
        self,
        keys: Sequence[bytes],
        seen: Sequence[NDArray[np.float32]],
        front_ends: Sequence[FrontEnd],
        noise: float,
        bits: int,
    ) -> Codes:
        """See `Receivers`."""
        volts, half = self._put(np.stack(seen)), 2 ** (bits - 1)
        scale_v, offset_v, position_div = (
            self._put(np.array(column, np.float32))[:, None, None] for column in zip(*front_ends, strict=True)
        )
        levels = digitiser_levels(bits)
        exact = (volts - offset_v) * (levels / scale_v) + levels * position_div
        exact += noise * self._unit(volts.shape, self._seeded(digest(keys[0], "digitiser")))
        whole = exact.round().clamp(-half, half - 1)
        codes = whole.to(torch.int8) if bits == 8 else whole.to(torch.int16) << 16 - bits
        return np.asarray(codes.cpu().numpy())

    def _sampled(
        self,
        optics: Placed,
        acquisition: Acquisition,
        grid: Grid,
        light: Light,
        after: NDArray[np.float32],
        before: NDArray[np.float32] | None,
    ) -> tuple[Tensor, Tensor]:
        """See `LightPath.sampled`."""
        constants, host = self._parameters, optics.host
        if not host.lit:
            zero = torch.zeros(len(after), len(acquisition.channels), acquisition.samples, device=self._place)
            return zero, zero
        shown = self._put(after)
        settled = shown if before is None else self._put(before)
        start_s = light.phase_s + grid.first_s - host.delay_s
        field = self._field(optics, shown, start_s, grid)
        if before is not None:
            times = light.age_s + grid.first_s + grid.step_s * np.arange(grid.points, dtype=np.float64)
            moved = mirrors.moved_fraction(times, leaves=constants.mirror_leaves_s, arrives=constants.mirror_arrives_s)
            old = self._field(optics, settled, start_s, grid)
            field = old + self._put(moved.astype(np.float32)) * (field - old)
        clean, slope = _filtered(grid, self._put(grid.sampling.matrix), _fast_volts(field), acquisition.samples)
        if optics.power_factors is not None:
            watts = (settled @ optics.power_factors).square().sum(dim=1)
            gain = (2 / (1 + (1 + 4 * watts / constants.amplifier_saturation_w).sqrt()))[:, None, None]
            clean, slope = clean * gain, slope * gain
        return clean, slope

    def _noisy(self, optics: Placed, clean: Tensor, white: torch.Generator, colour: NDArray[np.float32]) -> Tensor:
        """With the receivers' noise: see `NoiseLaws`."""
        images, channels, samples = clean.shape
        drawn = self._unit((images, channels + 1, samples + colour.size - 1), white)
        unit = torch.zeros(images, channels + 1, samples, device=self._place)
        for first, weight in enumerate(colour.tolist()):
            unit += weight * drawn[..., first : first + samples]
        signal, laws = clean.clamp(min=0), optics.host.laws
        if laws.count_v.any():  # few photons: their law is a table that the card does not have
            own = self._put(laws.own_noise(signal.cpu().numpy(), unit[:, :-1].cpu().numpy()))
        else:
            own = (optics.floor + optics.linear * signal).sqrt() * unit[:, :-1]
        return clean + own + optics.quadratic.sqrt() * signal * unit[:, -1:]

    def _field(self, optics: Placed, shown: Tensor, start_s: float, grid: Grid) -> Tensor:
        """Root volts (images, modes, channels, points) at the grid's light times from `start_s` on."""
        modes, superpixels, _ = optics.host.taps.shape
        sent = torch.view_as_complex((shown @ optics.sending.view(superpixels, -1)).view(len(shown) * modes, -1, 2))
        step_s = grid.step_s
        pages = (
            self._page(optics.setting, start_s + begin * step_s, step_s, min(_PAGE_POINTS, grid.points - begin))
            for begin in range(0, grid.points, _PAGE_POINTS)
        )
        channels = len(optics.fields)
        return torch.cat([(sent @ page).view(len(shown), modes, channels, -1) for page in pages], dim=-1)

    def _seeded(self, key: bytes) -> torch.Generator:
        return torch.Generator(self._place).manual_seed(int.from_bytes(key[:8], "little"))

    def _unit(self, shape: Sequence[int], source: torch.Generator) -> Tensor:
        return torch.randn(shape, generator=source, device=self._place)


def unusable(place: str = "cuda") -> str:
    """Why nothing can be computed on the device of torch that `place` names; empty where it can."""
    with warnings.catch_warnings(action="ignore"):  # which repeat it
        if place == "cuda" and not torch.cuda.is_available():
            return "torch finds no CUDA device"
        try:
            (torch.zeros(1, device=place) + 1).item()
        except RuntimeError as error:
            return f"torch cannot use the CUDA device ({str(error).partition(chr(10))[0]})"
    return ""


def _put(place: torch.device, values: NDArray[np.generic]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values)).to(place)


def _placed(light_path: LightPath, put: Callable[[NDArray[Any]], Tensor], setting: Setting) -> Placed:
    host = light_path.optics(setting)
    laws, factors = host.laws, host.power_factors
    columns = (put(column) for column in (laws.floor, laws.linear, laws.quadratic))
    placed_factors = None if factors is None else put(factors)
    return Placed(setting, host, put(host.sending), put(host.fields), placed_factors, *columns)


def _made_page(
    placed: Callable[[Setting], Placed],
    place: torch.device,
    setting: Setting,
    start_s: float,
    step_s: float,
    points: int,
) -> Tensor:
    """The ports' light at light times and at every delay before each, (delays, channels * points).

    See `chain.delayed`. Before and after a triggered segment the light does not change.
    """
    optics = placed(setting)
    host, (channels, period) = optics.host, optics.fields.shape
    times = start_s + step_s * np.arange(points, dtype=np.float64)
    if host.idle_s is not None:
        times = np.clip(times + host.idle_s, 0.0, period * host.step_s)
    index, weight = chain.interpolation(times / host.step_s, period)
    delays = torch.arange(host.taps.shape[-1], device=place)[:, None]
    page = torch.zeros(channels, len(delays), points, dtype=torch.complex64, device=place)
    for corner in np.flatnonzero(weight.any(axis=1)):
        page += optics.fields[:, (_put(place, index[corner]) - delays) % period] * _put(place, weight[corner])
    return page.transpose(0, 1).reshape(len(delays), -1)


def _fast_volts(field: Tensor) -> Tensor:
    """See `receiver.fast_volts`."""
    return torch.view_as_real(field).square().sum(dim=-1).sum(dim=1)


def _filtered(grid: Grid, matrix: Tensor, intensities: Tensor, samples: int) -> tuple[Tensor, Tensor]:
    """See `receiver.apply_filter`."""
    sampling = grid.sampling
    blocks, advance = -(-samples // sampling.samples), sampling.samples * sampling.decimation
    wanted = (blocks - 1) * advance + sampling.points
    padded = functional.pad(intensities, (0, max(0, wanted - intensities.shape[-1])))
    both = padded.unfold(-1, sampling.points, advance)[..., :blocks, :] @ matrix
    halves = both[..., : sampling.samples], both[..., sampling.samples :]
    clean, slope = (half.reshape(*intensities.shape[:-1], -1)[..., :samples] for half in halves)
    return clean, slope
