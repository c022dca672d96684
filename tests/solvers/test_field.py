"""One record over the wire, against the whole chain computed by brute force."""

import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.values import Drive, Timebase
from labctl.bench.opening import opened
from labctl.bench.station import Station
from protocols.ranging import find_ranges
from sim_backends.optics.lp_modes import lp_modes
from sim_backends.parameters import SPEED_OF_LIGHT, Parameters
from sim_backends.world.keyed_random import digest, generator
from sim_backends.world.twin import Twin
from tests.solvers.field import Draws, record

SEED = 11
STILL = {"trigger_jitter_s": 0.0, "awg_jitter_s": 0.0, "detector_nep_w_per_rthz": 0.0}
PORTS = (2, 3, 4, 5)
RATE, SAMPLES, AFTER_S = 25e9, 100, 100e-9
DRIVE = Drive("brute", np.random.default_rng(5).uniform(-1, 1, 1024).astype(np.float32), RATE, 0.5)
LEVELS = 1 << 9  # nine bits beside two markers
AVERAGES = 128


def draws(twin: Parameters) -> Draws:
    """What is random of the twin: its numbers in the order in which it draws them, and what each belongs to."""
    wavelength = twin.design_wavelength_nm * 1e-9
    drawn = Twin(twin, SEED)
    delays, chip = drawn._modes.delays_s, drawn._chip(1550)
    numbers = generator(digest(SEED, "fibre"))
    first, second = (numbers.standard_normal((2, size)) for size in (delays.size, twin.collecting_modes))
    arriving = (first[0] + 1j * first[1]) * np.exp(-2j * np.pi * (SPEED_OF_LIGHT / wavelength * delays % 1.0))
    highest = twin.launch_na * np.sqrt(-np.log(3e-3) / 2)
    launched = lp_modes(twin.core_diameter_m / 2, twin.fibre_na, wavelength, up_to_aperture=highest)
    seen = launched.reaching(twin.image_side * twin.core_diameter_m / np.sqrt(2))
    order, sine = seen.order[seen.twofold], np.arange(delays.size) >= seen.order.size
    excitation = {}
    for one in np.unique(order).tolist():
        cosines, sines = arriving[(order == one) & ~sine], arriving[(order == one) & sine]
        excitation[one] = np.stack([cosines, sines if one else np.zeros_like(cosines)], axis=1)
    return Draws(excitation, second[0] + 1j * second[1], chip.resonances_hz, chip.couplings)


def ring(points: int) -> NDArray[np.float64]:
    """A ring off the middle of so many by so many points."""
    row, column = (np.mgrid[:points, :points] + 0.5) / points
    away = np.hypot(row - 0.45, column - 0.55)
    return np.asarray((away > 0.2) & (away < 0.45), np.float64)


def superpixels(on: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mirrors (756, 756) of superpixels (28, 28)."""
    return np.repeat(np.repeat(on, 27, axis=0), 27, axis=1)


def mean_volts(bench: Bench) -> NDArray[np.float64]:
    """Mean of `AVERAGES` records, (channels, samples)."""
    frames = bench.capture()
    scale, offset = np.array([[scaling.scale_v, scaling.offset_v] for scaling in bench.scope.scalings()]).T
    return np.asarray(frames.codes[0] * scale[:, np.newaxis] + offset[:, np.newaxis], np.float64)


def measured(bench: Bench, mirrors: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Light above dark (V), (channels, samples), and the laser's power (W)."""
    whole = np.zeros((768, 1024), np.bool_)
    whole[6:762, 134:890] = mirrors > 0
    bench.load_drive(DRIVE)
    bench.connect(dict(enumerate(PORTS, start=1)))
    bench.configure(Timebase(RATE, SAMPLES, AFTER_S), range(1, len(PORTS) + 1), AVERAGES)
    bench.play_drive()
    with bench.emitting(1550.0):
        bench.show(np.packbits(whole, axis=1))
        find_ranges(bench, [bench.capture])
        lit, laser_w = mean_volts(bench), bench.laser.power()
        bench.laser.darken()
        return lit - mean_volts(bench), laser_w


def by_brute_force(laser_w: float, mirrors: NDArray[np.float64], scope_hz: float = 25e9) -> NDArray[np.float64]:
    twin = Parameters.model_validate(STILL | {"scope_bandwidth_hz": scope_hz})
    return record(
        twin,
        draws(twin),
        volts=np.rint(DRIVE.samples * LEVELS / 2) / LEVELS * DRIVE.amplitude_vpp,
        sample_rate=RATE,
        mirrors=mirrors,
        laser_w=laser_w,
        ports=PORTS,
        times=AFTER_S + np.arange(SAMPLES) / RATE,
    )


@pytest.mark.parametrize(
    ("grid", "largest"),
    [
        pytest.param({}, 0.02, id="on the twin's grid"),
        pytest.param(
            {"drive_step_s": 2.5e-12, "record_step_s": 5e-12}, 0.01, id="on a finer grid", marks=pytest.mark.full
        ),
    ],
)
def test_a_record_over_the_wire_is_the_field_of_the_whole_chain(
    grid: dict[str, float], largest: float, log: Any
) -> None:
    station = Station.model_validate({"sim": {"twin_seed": SEED, "parameters": STILL | grid}})
    with opened(station, log) as found:
        volts, laser_w = measured(found.bench, superpixels(ring(28)))
    expected = by_brute_force(laser_w, superpixels(ring(28)))
    away = np.sqrt(np.sum((volts - expected) ** 2) / np.sum(expected**2))
    ports = np.sqrt(np.mean((volts - expected) ** 2, axis=1) / np.mean(expected**2, axis=1))
    sys.stdout.write(
        f"record over the wire against brute force: {100 * away:.2f} % rms ("
        + ", ".join(f"port {port} {100 * part:.2f} %" for port, part in zip(PORTS, ports, strict=True))
        + f"), mean light {100 * (volts.mean() / expected.mean() - 1):+.2f} %\n"
    )
    assert away < largest


@pytest.mark.parametrize(
    ("scope", "scope_hz"),
    [({"bandwidth": "12.5 GHz"}, 12.5e9), ({"bandwidth": "4 GHz"}, 4e9), ({"driver": "tektronix-mso6b"}, 10e9)],
)
def test_a_record_behind_a_narrower_input_is_that_of_a_narrower_oscilloscope(
    scope: dict[str, str], scope_hz: float, log: Any
) -> None:
    station = Station.model_validate({"scope": scope, "sim": {"twin_seed": SEED, "parameters": STILL}})
    with opened(station, log) as found:
        volts, laser_w = measured(found.bench, superpixels(ring(28)))
    expected = by_brute_force(laser_w, superpixels(ring(28)), scope_hz)
    assert np.sqrt(np.sum((volts - expected) ** 2) / np.sum(expected**2)) < 0.02


@pytest.mark.full
def test_what_is_left_out_where_an_edge_goes_through_superpixels() -> None:
    """The twin takes a superpixel's mirrors together: images of whole superpixels lose nothing by it."""
    mirrors = ring(756)
    each = by_brute_force(0.03, mirrors)
    together = by_brute_force(0.03, superpixels(mirrors.reshape(28, 27, 28, 27).mean(axis=(1, 3))))
    away = np.sqrt(np.sum((together - each) ** 2) / np.sum(each**2))
    sys.stdout.write(f"superpixels against single mirrors, a round edge: {100 * away:.1f} % rms\n")
    assert away < 0.06
