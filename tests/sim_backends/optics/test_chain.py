import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backends.optics import cavity, chain, derived, fibre
from sim_backends.parameters import Parameters
from sim_backends.world.light_path import through_delays

PARAMETERS = Parameters()
RATE = 25e9


@pytest.fixture(scope="module")
def light() -> chain.DriveLight:
    volts = np.random.default_rng(0).uniform(-0.25, 0.25, 500).astype(np.float32)
    return chain.driven_light(PARAMETERS, volts, RATE)


@pytest.fixture(scope="module")
def chip() -> cavity.Cavity:
    return cavity.draw_cavity(
        np.random.default_rng(1), modes=320, density=derived.mode_density_per_hz(PARAMETERS), ports=14, transmission=0.9
    )


@pytest.fixture(scope="module")
def transfer(light: chain.DriveLight, chip: cavity.Cavity) -> NDArray[np.complex128]:
    return chain.chip_transfer(PARAMETERS, chip, step_s=light.step_s, detuning_hz=0.0)


@pytest.fixture(scope="module")
def taps() -> NDArray[np.complex64]:
    modes = chain.draw_fibre(PARAMETERS, np.random.default_rng(2))
    folded, _ = fibre.delay_taps(modes, frequency_hz=193.4e12, step=5e-12)
    return folded


def masks_at(
    fields: NDArray[np.complex64], taps: NDArray[np.complex64], times: NDArray[np.float64], step_s: float
) -> NDArray[np.float32]:
    """The masks C of one collected mode, real and imaginary parts: (superpixels, 2 * channels * K)."""
    (of_mode,) = taps
    masks = of_mode @ chain.delayed(fields, taps.shape[-1], times, step_s)
    return np.concatenate([masks.real, masks.imag], axis=1)


def test_grid_is_five_picoseconds_and_light_has_unit_power(light: chain.DriveLight) -> None:
    assert light.step_s == pytest.approx(5e-12)
    assert light.period_s == pytest.approx(20e-9)
    np.testing.assert_allclose(np.abs(light.field), 1.0, atol=1e-6)


def test_bypass_is_the_modulated_light_itself(light: chain.DriveLight, transfer: NDArray[np.complex128]) -> None:
    fields = chain.port_fields(light, transfer, [(chain.BYPASS, 0.5), (3, 0.0)])
    np.testing.assert_allclose(fields[0], 0.5 * light.field, atol=1e-6)
    assert not fields[1].any()


def test_the_chip_answers_alike_on_every_grid_that_is_fine_enough(chip: cavity.Cavity) -> None:
    volts = np.random.default_rng(0).uniform(-0.25, 0.25, 250).astype(np.float32)
    answers = []
    for step_s in (1e-12, 0.5e-12):
        parameters = Parameters(drive_step_s=step_s)
        light = chain.driven_light(parameters, volts, RATE)
        transfer = chain.chip_transfer(parameters, chip, step_s=light.step_s, detuning_hz=0.0)
        answers.append(chain.port_fields(light, transfer, [(2, 1.0), (3, 1.0)])[:, :: round(1e-12 / light.step_s)])
    np.testing.assert_allclose(answers[1], answers[0], atol=0.01)


def test_the_chip_never_gives_more_than_it_gets(light: chain.DriveLight, transfer: NDArray[np.complex128]) -> None:
    ports = [(port, 1.0) for port in range(1, 15)]
    power = np.mean(np.abs(chain.port_fields(light, transfer, ports)) ** 2, axis=1)
    assert power.sum() <= 1.0
    assert power.sum() == pytest.approx(0.7, abs=0.12)


def test_wrapped_response_is_that_of_a_repeated_drive(
    light: chain.DriveLight, transfer: NDArray[np.complex128]
) -> None:
    once = chain.port_fields(light, transfer, [(4, 1.0)])
    thrice = chain.port_fields(chain.DriveLight(np.tile(light.field, 3), light.step_s), transfer, [(4, 1.0)])
    np.testing.assert_allclose(thrice, np.tile(once, 3), atol=1e-5)


def test_idle_light_is_one_grid_point_with_the_static_answer(transfer: NDArray[np.complex128]) -> None:
    field = chain.port_fields(chain.idle_light(PARAMETERS), transfer, [(4, 1.0)])
    assert field.shape == (1, 1)
    assert field[0, 0] == pytest.approx(transfer[3, 0], abs=1e-6)


def test_interpolation_is_exact_on_the_grid_and_good_between() -> None:
    grid = np.cos(2 * np.pi * np.arange(200) / 40)
    index, weight = chain.interpolation(np.array([5.0, 5.25, -0.5, 399.99999]), 200)
    np.testing.assert_allclose(weight[:, 0], [0, 1, 0, 0])
    value = (grid[index] * weight).sum(axis=0)
    np.testing.assert_allclose(value, np.cos(2 * np.pi * np.array([5, 5.25, -0.5, 0]) / 40), atol=1e-4)


def test_masks_are_the_sum_over_delays(
    light: chain.DriveLight, transfer: NDArray[np.complex128], taps: NDArray[np.complex64]
) -> None:
    fields = chain.port_fields(light, transfer, [(2, 1.0), (5, 1.0)])
    times = np.array([0.0, 35e-12, 19.99e-9])
    masks = masks_at(fields, taps, times, light.step_s).reshape(-1, 1, 2, 2, 3)
    superpixel, channel, k = 7, 1, 1
    delays = np.arange(taps.shape[2])
    expected = np.sum(taps[0, superpixel] * fields[channel, (7 - delays) % fields.shape[1]])
    assert masks[superpixel, 0, 0, channel, k] == pytest.approx(expected.real, rel=1e-3, abs=1e-7)
    assert masks[superpixel, 0, 1, channel, k] == pytest.approx(expected.imag, rel=1e-3, abs=1e-7)


@pytest.mark.parametrize("every", [1, 2, 3])
@pytest.mark.parametrize("start", [0.0, -300.25, 3990.0, 12345.5])
def test_a_convolution_is_the_sum_over_delays(
    light: chain.DriveLight, transfer: NDArray[np.complex128], taps: NDArray[np.complex64], start: float, every: int
) -> None:
    """Of two modes behind two ports and the bypass, from anywhere in the period and across its end."""
    two_modes, points = np.concatenate([taps, 1j * taps[:, ::-1]]), 60
    fields = chain.port_fields(light, transfer, [(2, 1.0), (5, 1.0), (chain.BYPASS, 1.0)])
    pictures = np.random.default_rng(3).random(size=(5, taps.shape[1]), dtype=np.float32)
    sent = np.asarray((pictures @ two_modes).swapaxes(0, 1), np.complex64)
    times = (start + every * np.arange(points, dtype=np.float64)) * light.step_s
    delayed = chain.delayed(fields, taps.shape[-1], times, light.step_s)
    expected = np.matmul(sent, delayed).reshape(5, 2, 3, points)
    spectrum = chain.window_spectrum(fields, taps.shape[-1], start=start, points=points, every=every)
    through = through_delays(sent, spectrum, points)
    np.testing.assert_allclose(through, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("images", [1, 2, 3, 5, 8, 17])
def test_number_of_images_changes_no_byte_of_a_convolution(images: int) -> None:
    rng = np.random.default_rng(5)
    sent = np.asarray(rng.normal(size=(17, 1, 236)) + 1j * rng.normal(size=(17, 1, 236)), np.complex64)
    fields = np.asarray(rng.normal(size=(3, 4000)) + 1j * rng.normal(size=(3, 4000)), np.complex64)
    spectrum = chain.window_spectrum(fields, 236, start=17.25, points=216, every=2)
    some = through_delays(sent[:images], spectrum, 216)
    assert np.array_equal(some, through_delays(sent, spectrum, 216)[:images])


def test_masks_change_within_one_symbol(
    light: chain.DriveLight, transfer: NDArray[np.complex128], taps: NDArray[np.complex64]
) -> None:
    fields = chain.port_fields(light, transfer, [(chain.BYPASS, 1.0)])
    times = np.arange(400, dtype=np.float64) * 40e-12
    split = masks_at(fields, taps, times, light.step_s).reshape(-1, 2, times.size)
    intensity = np.abs(split[:, 0] + 1j * split[:, 1]) ** 2
    intensity = intensity - intensity.mean(axis=1, keepdims=True)
    lag = np.mean(intensity[:, 1:] * intensity[:, :-1]) / np.mean(intensity**2)
    assert abs(lag) < 0.15


def test_mask_contrast_is_one(
    light: chain.DriveLight, transfer: NDArray[np.complex128], taps: NDArray[np.complex64]
) -> None:
    fields = chain.port_fields(light, transfer, [(chain.BYPASS, 1.0)])
    split = masks_at(fields, taps, np.arange(400, dtype=np.float64) * 40e-12, light.step_s).reshape(-1, 2, 400)
    intensity = np.abs(split[:, 0] + 1j * split[:, 1]) ** 2
    contrast = intensity.std(axis=1) / intensity.mean(axis=1)
    assert contrast.mean() == pytest.approx(1.0, abs=0.15)  # in time, superpixel by superpixel: each has its brightness


def test_power_factors_give_the_mean_over_the_period(light: chain.DriveLight, taps: NDArray[np.complex64]) -> None:
    some = np.random.default_rng(5).random(size=(3, taps.shape[1]), dtype=np.float32)
    factors = chain.power_factors(light, taps)
    masks = masks_at(light.field[np.newaxis], taps, np.arange(4000, dtype=np.float64) * light.step_s, light.step_s)
    mean = np.square(some @ masks).reshape(3, 2, -1).sum(axis=1).mean(axis=1)
    np.testing.assert_allclose(np.square(some @ factors).sum(axis=1), mean, rtol=2e-3)


@pytest.mark.parametrize(
    "parameters",
    [
        Parameters(fibre_length_m=80.0),
        Parameters(fibre_length_m=200.0, core_diameter_m=50e-6, drive_step_s=20e-12),
    ],
)
def test_power_factors_of_a_fibre_so_long_that_some_delays_have_no_light(parameters: Parameters) -> None:
    volts = np.random.default_rng(0).uniform(-0.25, 0.25, 500).astype(np.float32)
    light = chain.driven_light(parameters, volts, RATE)
    modes = chain.draw_fibre(parameters, np.random.default_rng(2))
    taps, _ = fibre.delay_taps(modes, frequency_hz=193.4e12, step=light.step_s)
    assert not np.abs(taps).any(axis=(0, 1)).all()
    some = np.random.default_rng(5).random(size=(3, taps.shape[1]), dtype=np.float32)
    mean = [chain.mean_volts(picture, light.field[np.newaxis], taps)[0] for picture in some]
    np.testing.assert_allclose(np.square(some @ chain.power_factors(light, taps)).sum(axis=1), mean, rtol=2e-3)


def test_power_factors_of_idle_light_are_those_of_one_speckle(taps: NDArray[np.complex64]) -> None:
    factors = chain.power_factors(chain.idle_light(PARAMETERS), taps)
    assert factors.shape == (784, 2)
    assert np.sum(factors.sum(axis=0) ** 2) == pytest.approx(abs(taps.sum()) ** 2, rel=1e-3)


def test_mean_volts_is_the_mean_over_the_period(
    light: chain.DriveLight, transfer: NDArray[np.complex128], taps: NDArray[np.complex64]
) -> None:
    fields = chain.port_fields(light, transfer, [(2, 1.0), (chain.BYPASS, 1.0)])
    amplitudes = np.random.default_rng(4).random(size=(taps.shape[1],), dtype=np.float32)
    masks = masks_at(fields, taps, np.arange(4000, dtype=np.float64) * light.step_s, light.step_s)
    volts = np.square((amplitudes @ masks).reshape(2, 2, 4000)).sum(axis=0)
    np.testing.assert_allclose(chain.mean_volts(amplitudes, fields, taps), volts.mean(axis=1), rtol=1e-4)


def test_a_dark_port_has_thermal_noise_only(transfer: NDArray[np.complex128]) -> None:
    dark = chain.port_noise(PARAMETERS, transfer, None, 5e-12, scope_hz=25e9)
    lit = chain.port_noise(PARAMETERS, transfer, 3, 5e-12, scope_hz=25e9)
    assert dark.offset_v == 0.0
    assert np.sqrt(dark.floor) / 600 == pytest.approx(2.7e-6, rel=0.02)
    assert lit.offset_v > 0
    assert lit.linear > 5 * dark.linear  # signal-ASE beat, not shot noise


def test_power_budget_without_amplifiers_is_nanowatts(light: chain.DriveLight) -> None:
    bare = Parameters(booster_gain_db=0.0, amplifier_gain_db=0.0)
    overlaps = []
    for seed in range(20):
        taps, _ = fibre.delay_taps(
            chain.draw_fibre(bare, np.random.default_rng(seed)), frequency_hz=193.4e12, step=5e-12
        )
        overlaps.append(np.sum(chain.power_factors(light, taps).sum(axis=0) ** 2))
    assert 0.03 * np.mean(overlaps) * chain.port_transmission(bare, 3) * 0.04 == pytest.approx(60e-9, rel=0.5)  # all on


def test_direct_path_has_no_speckle() -> None:
    direct = Parameters(light_path="direct")
    modes = chain.draw_fibre(direct, np.random.default_rng(0))
    assert modes.delays_s.tolist() == [0.0]
    assert chain.volts_per_field(direct, 2, 0.03) == pytest.approx(0.03 * 600 * 10 ** (-0.95))
