"""The receivers by torch: the light of the processor's, and noise that is another stream of the same.

Torch computes the same on a processor, so this is tested everywhere; where there is a CUDA device, on it as well.
"""

import gc
import subprocess
import sys
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from sim_backends.parameters import Parameters
from sim_backends.world.card import CardReceivers, unusable
from sim_backends.world.receivers import CardFull, FrontEnd, ProcessorReceivers
from sim_backends.world.signals import Acquisition, Emission, Record
from sim_backends.world.world import World
from tests.sim_backends.world import test_bursts as bursts
from tests.sim_backends.world.light import FOUR, RATE, bench, coming, picture, playback, quiet, shoot

LONG = Acquisition((1, 2, 3, 4), RATE, 1200, -5e-9)
"""More times than one page of fields has."""
FINE = Acquisition((1, 3), 100e9, 90, 1e-9)
ONSET = Acquisition((1, 2, 3, 4), RATE, 200, 94e-9)
TRIGGERS = 4000
BRIGHT = Emission(1550.0, 300.0)
"""Enough for its shot noise not to be seen."""


@pytest.fixture(params=["cpu", "cuda"])
def on_card(request: pytest.FixtureRequest) -> Callable[[World], World]:
    if request.param == "cuda" and not torch.cuda.is_available():
        pytest.skip("no CUDA device here")

    def moved(world: World) -> World:
        world.receivers = CardReceivers(world._light_path, world.parameters, request.param)
        return world

    return moved


def of_one_picture(world: World) -> Record:
    return shoot(world, count=3, acquisition=LONG)


def of_an_odd_drive_rate(world: World) -> Record:
    world.play(replace(playback(), sample_rate=23.7e9))
    return shoot(world, acquisition=LONG)


def of_fine_samples(world: World) -> Record:
    return shoot(world, count=2, acquisition=FINE)


def of_a_bypass(world: World) -> Record:
    world.patch({1: 0, 3: 0})
    return shoot(world, count=2, acquisition=FINE)


def of_an_amplified_light(world: World) -> Record:
    world.amplify(1e6)
    return shoot(world)


def of_the_dark(world: World) -> Record:
    world.emit(None)
    return shoot(world)


def of_moving_mirrors(world: World) -> Record:
    world.show(picture(9))
    world.clock.advance(0.9e-6)
    times = coming(world)
    (age_s,) = world._pictures.sight(times, begins_s=0.0, ends_s=FOUR.samples / RATE).age_s
    assert world.parameters.mirror_leaves_s < age_s < world.parameters.mirror_arrives_s
    return world.record(FOUR, times)


def of_a_burst(world: World) -> Record:
    world.play(bursts.THREE)
    bursts.burst(world, 9)
    times = bursts.coming(world, 9)
    return world.record(ONSET, times)


def of_a_picture_that_goes_on(world: World) -> Record:
    record = shoot(world)
    return Record(record.further(LONG), record.trigger_offset_s, record.keys, record.further)


@pytest.mark.parametrize(
    "recorded",
    [
        of_one_picture,
        of_an_odd_drive_rate,
        of_fine_samples,
        of_a_bypass,
        of_an_amplified_light,
        of_the_dark,
        of_moving_mirrors,
        of_a_burst,
        of_a_picture_that_goes_on,
    ],
)
@pytest.mark.parametrize(
    "parameters",
    [
        quiet(),
        quiet(detector_coupling="ac"),
        quiet(light_path="direct"),
        quiet(laser_wander_hz=1e9, chip_wander_hz=1e9, wander_time_s=10.0),
        quiet().model_copy(update={"detector_limit_v": 300.0}),  # about what there is of such light
    ],
    ids=["usual", "ac", "direct", "drifting", "limited"],
)
def test_the_light_is_that_of_the_processor(
    recorded: Callable[[World], Record], parameters: Parameters, on_card: Callable[[World], World]
) -> None:
    processor, card = bench(parameters=parameters), on_card(bench(parameters=parameters))
    for world in (processor, card):
        world.emit(BRIGHT)
    expected, volts = recorded(processor).volts, recorded(card).volts
    assert volts.dtype == expected.dtype
    np.testing.assert_allclose(volts, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


def test_samples_that_slip_against_the_drive_stay_on_its_trace(on_card: Callable[[World], World]) -> None:
    slipping = quiet(shared_reference=False)
    record = shoot(on_card(bench(parameters=slipping)), count=200)
    offsets, volts = record.trigger_offset_s * RATE, record.volts[:, :, 1:-1]
    assert np.ptp(offsets) > 0.9
    curved = np.polynomial.polynomial.polyfit(offsets, volts.reshape(len(volts), -1), 7)
    fitted = np.polynomial.polynomial.polyval(offsets, curved).T.reshape(volts.shape)
    assert np.sqrt(np.mean((volts - fitted) ** 2)) < 5e-3 * volts.std()


def moments(volts: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation of every sample, and correlation of neighbouring samples, by channel."""
    noise = volts - volts.mean(axis=0)
    unit = noise / noise.std(axis=0)
    return volts.mean(axis=0), noise.std(axis=0), (unit[..., 1:] * unit[..., :-1]).mean(axis=(0, 2))


@pytest.mark.parametrize(
    "parameters",
    [
        Parameters(),
        Parameters(laser_rin_db_per_hz=-115.0),
        Parameters(amplifier_gain_db=0.0, booster_gain_db=20.0, detector_nep_w_per_rthz=1e-15),
    ],
    ids=["usual", "noisy laser", "few photons"],
)
@pytest.mark.parametrize("rate_hz", [25e9, 100e9])
def test_noise_has_the_moments_and_the_spectrum_of_the_processors(
    parameters: Parameters, rate_hz: float, on_card: Callable[[World], World]
) -> None:
    acquisition = Acquisition((1, 2, 3, 4), rate_hz, 24, 0.0)
    first, second = (
        shoot(world, count=TRIGGERS, acquisition=acquisition).volts.astype(np.float64)
        for world in (bench(parameters=parameters), on_card(bench(parameters=parameters)))
    )
    (mean, spread, neighbours), (own_mean, own_spread, own_neighbours) = moments(first), moments(second)
    assert np.abs((own_mean - mean) / (spread * np.sqrt(2 / TRIGGERS))).max() < 5
    assert np.abs(own_spread / spread - 1).max() < 5 / np.sqrt(TRIGGERS)
    assert np.abs(own_neighbours - neighbours).max() < 5 / np.sqrt(TRIGGERS)
    between, own_between = (np.corrcoef(volts[:, :, 5], rowvar=False) for volts in (first, second))
    assert np.abs(own_between - between).max() < 5 * np.sqrt(2 / TRIGGERS)


@pytest.mark.parametrize("lit", [True, False])
def test_ac_coupling_takes_volts_away_and_no_noise(lit: bool, on_card: Callable[[World], World]) -> None:
    """The mean over the drive's period goes, of the amplifier's own light too; what the detector saw has its noise."""
    period = Acquisition((1, 2), 4 * RATE, 2000, 0.0)
    noisy = {"detector_limit_v": 1e6, "laser_rin_db_per_hz": -125.0}
    for moved in (lambda world: world, on_card):
        coupled = {}
        for coupling in ("dc", "ac"):
            world = moved(bench(parameters=Parameters.model_validate({**noisy, "detector_coupling": coupling})))
            if not lit:
                world.emit(None)
            coupled[coupling] = shoot(world, count=50, acquisition=period).volts.astype(np.float64)
        away, noise = coupled["dc"] - coupled["ac"], coupled["dc"].std(axis=0)
        constant = away.mean(axis=(0, 2))
        assert np.abs(away - constant[:, np.newaxis]).max() < 1e-3 * noise.mean()
        assert constant == pytest.approx(coupled["dc"].mean(axis=(0, 2)), rel=0.02, abs=5 * noise.mean() / 150)
        assert np.all(constant > 0)


@pytest.mark.parametrize("bits", [8, 12])
def test_codes_have_the_digitisers_error(bits: int, on_card: Callable[[World], World]) -> None:
    seen = [np.linspace(-0.2, 0.2, 50_000, dtype=np.float32).reshape(500, 100), np.full((500, 100), 9.0, np.float32)]
    front_ends, keys = (
        [FrontEnd(0.05, 0.01, 0.5), FrontEnd(0.1, 0.0, 0.0)],
        [bytes([number % 250] * 16) for number in range(500)],
    )
    (processor, limit), (card, own_limit) = (
        world.receivers.digitised(keys[:250] + keys[:250], seen, front_ends, 1.2, bits)
        for world in (World(), on_card(World()))
    )
    assert card.dtype == processor.dtype
    assert np.array_equal(limit, own_limit)
    inside = np.abs(processor) < 0.9 * np.abs(processor).max()
    difference = (card.astype(np.float64) - processor)[inside] / (1 if bits == 8 else 16)
    expected = np.sqrt(2 * (1.2**2 + 1 / 12))
    assert difference.std() == pytest.approx(expected, rel=5 / np.sqrt(2 * difference.size))
    assert abs(difference.mean()) < 5 * expected / np.sqrt(difference.size)


def test_the_same_state_has_the_same_noise(on_card: Callable[[World], World]) -> None:
    first, again = (shoot(on_card(bench(noise="by-state")), count=5).volts for _ in range(2))
    assert np.array_equal(first, again)
    assert len(np.unique(first.reshape(5, -1), axis=0)) == 5


def test_a_device_that_cannot_compute_is_told_in_one_line() -> None:
    assert unusable("cpu") == ""
    why = unusable("meta")  # which has no numbers
    assert why.startswith("torch cannot use the CUDA device (")
    assert "\n" not in why


def test_a_torch_that_does_not_load_leaves_the_processor(tmp_path: Path) -> None:
    (tmp_path / "torch.py").write_text("raise OSError('libcudart.so.12: cannot open shared object file')\n", "utf-8")
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from sim_backends.world.world import World; "
        "print(World(device='cuda').fallback)"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert told.stdout == "torch does not load (libcudart.so.12: cannot open shared object file)\n"


def test_receivers_that_are_no_longer_used_leave_the_card_at_once() -> None:
    world = bench()
    card = CardReceivers(world._light_path, world.parameters, "cpu")
    world.receivers, gone = card, weakref.ref(card)
    shoot(world)
    world.receivers = ProcessorReceivers(world._light_path, world.parameters)
    gc.disable()
    try:
        del card
        assert gone() is None
    finally:
        gc.enable()


def test_a_card_without_room_is_an_error_of_its_own(
    on_card: Callable[[World], World], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")

    world = on_card(bench())
    monkeypatch.setattr(torch, "randn", full)
    with pytest.raises(CardFull, match=r"sim\.device = cpu"):
        shoot(world)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_without_a_card_the_processor_computes() -> None:
    usual, without = bench(), World(device="cuda")
    assert (usual.fallback, without.fallback) == ("", "torch finds no CUDA device")
    assert isinstance(without.receivers, ProcessorReceivers)
