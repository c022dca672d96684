import numpy as np
import pytest

from sim_backends.optics import cavity

DENSITY = 1.044e-9
LOSS = 1 / (2 * np.pi * 200e-12)


def draw(seed: int, ports: int = 14, transmission: float = 0.9) -> cavity.Cavity:
    return cavity.draw_cavity(
        np.random.default_rng(seed), modes=320, density=DENSITY, ports=ports, transmission=transmission
    )


def test_weyl_density_of_the_stadium_is_one_per_gigahertz() -> None:
    density = cavity.weyl_density(radius=25e-6, straight=100e-6, index=2.85, group_index=3.9, wavelength=1550e-9)
    assert density == pytest.approx(1.04e-9, rel=0.01)


def test_drawn_resonances_have_that_density_around_the_carrier() -> None:
    counts = [np.sum(np.abs(draw(seed).resonances_hz) < 40e9) for seed in range(8)]
    assert np.mean(counts) / 80 == pytest.approx(1.03, abs=0.03)  # levels repel: the count hardly fluctuates


@pytest.mark.parametrize("transmission", [0.1, 0.5, 0.9, 1.0])
def test_coupling_inverts_the_transmission(transmission: float) -> None:
    kappa = cavity.coupling_strength(transmission)
    assert 4 * kappa / (1 + kappa) ** 2 == pytest.approx(transmission)


def test_lossless_cavity_is_unitary_and_reciprocal() -> None:
    s = cavity.scattering_matrix(draw(1), np.linspace(-30e9, 30e9, 101), loss_hz=0.0)
    np.testing.assert_allclose(s @ s.conj().transpose(0, 2, 1), np.broadcast_to(np.eye(14), s.shape), atol=1e-8)
    np.testing.assert_allclose(s, s.transpose(0, 2, 1), atol=1e-8)


def test_with_loss_power_is_only_lost() -> None:
    s = cavity.scattering_matrix(draw(2), np.linspace(-60e9, 60e9, 400), loss_hz=LOSS)
    power = np.sum(np.abs(s) ** 2, axis=1)
    assert power.max() <= 1.0
    assert power.mean() == pytest.approx(0.7, abs=0.1)


def test_a_port_sees_a_twentyfifth_of_the_light() -> None:
    power = []
    for seed in range(6):
        s = cavity.scattering_matrix(draw(seed), np.linspace(-30e9, 30e9, 300), loss_hz=LOSS)
        power.append(np.mean(np.abs(s[:, 1:6, 9]) ** 2))
    assert np.mean(power) == pytest.approx(0.045, abs=0.015)


def test_response_is_causal_in_numpys_convention() -> None:
    for seed in range(3):
        transfer = cavity.transfer(draw(seed), points=4096, step=5e-12, detuning_hz=0.0, loss_hz=LOSS, input_port=10)
        frequency = np.fft.fftfreq(4096, 5e-12)
        pulse = 1 / (1 + 1j * frequency / 14e9) / (1 + 1j * frequency / 16e9)  # the fastest the drive can be
        energy = np.abs(np.fft.ifft(transfer[1:6] * pulse)) ** 2
        assert energy[:, :2048].sum() > 0.999 * energy.sum()
        backwards = np.abs(np.fft.ifft(transfer[1:6].conj() * pulse)) ** 2
        assert backwards[:, :2048].sum() < 0.9 * backwards.sum()


def test_light_stays_some_tens_of_picoseconds() -> None:
    spectra = [
        cavity.transfer(draw(n), points=4096, step=5e-12, detuning_hz=0.0, loss_hz=LOSS, input_port=10)
        for n in range(4)
    ]
    energy = np.mean([np.abs(np.fft.ifft(s[:9])) ** 2 for s in spectra], axis=(0, 1))[:400]
    lifetime = np.sum(energy * np.arange(400)) / energy.sum() * 5e-12
    assert 30e-12 < lifetime < 110e-12


def test_detuning_shifts_the_same_resonances() -> None:
    chip = draw(5)
    frequency = np.linspace(-5e9, 5e9, 11)
    moved = cavity.scattering_matrix(cavity.Cavity(chip.resonances_hz + 1e9, chip.couplings), frequency, loss_hz=LOSS)
    np.testing.assert_allclose(cavity.scattering_matrix(chip, frequency - 1e9, loss_hz=LOSS), moved, atol=1e-9)
