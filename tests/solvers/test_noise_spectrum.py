"""The power spectrum of noise in records over the wire: the receiver's one pole and Gaussian, and a white part."""

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import welch

from instruments.bench import Bench
from instruments.interfaces import BYPASS_PORT
from instruments.values import Drive, Timebase
from labctl.bench.opening import OpenBench, opened
from labctl.bench.station import Station
from protocols.ranging import find_ranges
from sim_backends.parameters import PLANCK, SPEED_OF_LIGHT, Parameters

TWIN = Parameters()
SAMPLES, RECORDS, SEGMENT = 5000, 40, 100
CHARGE = 1.602176634e-19
CODES = 256
STILL = {"trigger_jitter_s": 0.0, "awg_jitter_s": 0.0}


@pytest.fixture
def open_bench(log: Any) -> Iterator[OpenBench]:
    with opened(Station.model_validate({"sim": {"parameters": STILL}}), log) as found:
        yield found


def expected(
    sample_rate: float, mean_v: NDArray[np.float64], range_v: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies (Hz) and one-sided power density (V^2/Hz) of the noise of a record behind the bypass.

    `mean_v` is the record without noise; what grows with the light is taken at its mean over the record. The receiver's
    part is folded back at half the sample rate; the digitiser's is white up to there.
    """
    fine = np.linspace(0, 200e9, 20_001)
    response = shape(fine)
    bandwidth = float(np.trapezoid(response, fine))
    gain, photon = TWIN.detector_gain_v_per_w, PLANCK * SPEED_OF_LIGHT / (TWIN.design_wavelength_nm * 1e-9)
    amplified = 10 ** (TWIN.amplifier_noise_figure_db / 10) / 2 * photon * (10 ** (TWIN.amplifier_gain_db / 10) - 1)
    density = amplified * 10 ** (-TWIN.bypass_attenuation_db / 10)
    own_w = density * TWIN.amplifier_filter_hz
    light_w = np.maximum(mean_v / gain - own_w, 0.0)
    mean_w = float(light_w.mean())
    white = TWIN.detector_nep_w_per_rthz**2 + 2 * CHARGE / TWIN.detector_responsivity_a_per_w * (own_w + mean_w)
    white += 2 * density**2 * (TWIN.amplifier_filter_hz - bandwidth / 2) + 4 * density * mean_w
    white += 10 ** (TWIN.laser_rin_db_per_hz / 10) * float(np.mean(light_w**2))
    frequencies = np.asarray(np.fft.rfftfreq(SEGMENT, 1 / sample_rate), np.float64)
    folded = sum((shape(frequencies + n * sample_rate) for n in range(-8, 9)), np.zeros_like(frequencies))
    digitiser = (range_v / 2**TWIN.enob) ** 2 / 12 * 2 / sample_rate
    return frequencies, np.asarray(gain**2 * white * folded + digitiser, np.float64)


def shape(frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Power response of detector and oscilloscope."""
    one_pole = 1 + (frequency / TWIN.detector_bandwidth_hz) ** 2
    return np.asarray(np.exp(-np.log(2) * (frequency / TWIN.scope_bandwidth_hz) ** 2) / one_pole, np.float64)


def records(bench: Bench) -> NDArray[np.float64]:
    """Volts of one acquisition after the other, (records, samples)."""
    codes = np.stack([bench.capture().codes[0, 0] for _ in range(RECORDS)])
    (scaling,) = bench.scope.scalings()
    return np.asarray(codes * scaling.scale_v + scaling.offset_v, np.float64)


@pytest.mark.parametrize("light", ["dark", "still light", "modulated light"])
@pytest.mark.parametrize("sample_rate", [25e9, 100e9], ids=["25 GS/s", "100 GS/s"])
def test_noise_has_the_spectrum_of_the_receiver(sample_rate: float, light: str, bench: Bench) -> None:
    depth = 1.0 if light == "modulated light" else 0.0
    samples = depth * np.random.default_rng(1).uniform(-1, 1, 2500)
    bench.load_drive(Drive("noise", samples.astype(np.float32), 25e9, 0.5))
    bench.connect({1: BYPASS_PORT})
    bench.configure(Timebase(sample_rate, SAMPLES), (1,))
    bench.play_drive()
    with bench.emitting(1550.0):
        few = np.zeros((768, 128), np.uint8)
        few[288:480, 52:76] = 255  # dim enough for the detector to be linear
        bench.show(few)
        if light == "dark":
            bench.laser.darken()
        find_ranges(bench, [bench.capture])
        volts = records(bench)
        (scaling,) = bench.scope.scalings()
    noise = (volts - volts.mean(axis=0)) * np.sqrt(RECORDS / (RECORDS - 1))
    frequencies, model = expected(sample_rate, volts.mean(axis=0), CODES * scaling.scale_v)
    _, dark = expected(sample_rate, np.zeros(1), CODES * scaling.scale_v)
    _, measured = welch(noise, sample_rate, nperseg=SEGMENT, detrend=False)
    ratio = (measured.mean(axis=0) / model)[1:-1]
    sys.stdout.write(
        f"noise at {sample_rate / 1e9:.0f} GS/s, {light} (at low frequency {model[1] / dark[1]:.2f} times the dark's): "
        f"spectrum over model {ratio.mean():.3f}, {100 * np.sqrt(np.mean((ratio - 1) ** 2)):.1f} % rms, "
        f"{100 * np.abs(ratio - 1).max():.1f} % at most, up to {frequencies[-2] / 1e9:.1f} GHz\n"
    )
    assert ratio == pytest.approx(1.0, abs=0.12)
    assert np.sqrt(np.mean((ratio - 1) ** 2)) < 0.04
