"""Is there light? What probes have in common, and what a bench without light says before it records anything."""

from typing import Any

import numpy as np
import pytest

from instruments.errors import InstrumentError
from instruments.values import Frames, Timebase
from labctl.bench.opening import opened
from labctl.bench.station import SimSection, Station, WiringSection
from labctl.engine.inputs import images_for, inputs_for
from protocols.base import Measurement
from protocols.dynamic_scene import DynamicScene
from protocols.ghost_imaging import GhostImaging
from protocols.image_readout import ImageReadout
from protocols.light import in_common, require_light
from protocols.wavelength_scan import WavelengthScan
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import Fault, Moment
from tests.observers import Follower

PROBES, CHANNELS, SAMPLES = 40, 4, 10


def noise(seed: int, probes: int = PROBES) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.random.default_rng(seed).normal(0, 8, (probes, CHANNELS, SAMPLES))


def frames_of(codes: np.ndarray[Any, Any]) -> list[Frames]:
    return [
        Frames(one[np.newaxis].astype(np.int8), np.zeros((1, CHANNELS)), np.zeros(1), np.zeros((1, CHANNELS), bool))
        for one in codes
    ]


def test_noise_has_nothing_in_common() -> None:
    found = np.array([in_common(noise(seed)) for seed in range(4000)])
    assert found.mean() == pytest.approx(1, abs=0.02)
    assert in_common(np.zeros((4, 2, 5), np.int8)).tolist() == [1, 1]


def test_a_course_at_a_third_of_the_noise_is_light() -> None:
    course = np.random.default_rng(1).normal(0, 8 / 3, (CHANNELS, SAMPLES))
    assert all(in_common(noise(seed) + course).mean() > 3 for seed in range(100))


def test_a_channel_without_light_is_told(bench: Any) -> None:
    warned: list[str] = []
    bench.observer = Follower(warning=warned.append)
    bench.configure(Timebase(25e9, SAMPLES), (1, 2, 3, 4))
    course = np.random.default_rng(1).normal(0, 8, (CHANNELS, SAMPLES))
    course[2] = 0
    require_light(bench, frames_of(noise(1) + course), None)
    assert warned == ["scope: CH3 has no light that can be told from noise: see its fibre"]
    dark = iter(frames_of(noise(2))).__next__
    require_light(bench, frames_of(noise(1) + 2), dark)  # photons so few that their course is hidden
    with pytest.raises(InstrumentError, match=r"^bench: no light: 40 probes"):
        require_light(bench, frames_of(noise(1)), dark)


@pytest.mark.parametrize("broken", [{"fibre_loss_db": 300.0}, {"mirror_loss_db": 300.0}], ids=str)
@pytest.mark.parametrize(
    "protocol",
    [
        ImageReadout(images=40),
        ImageReadout(images=40, timing="burst", window=0.4e-9),
        ImageReadout(images=24, averages=4, ports=(2,)),
        WavelengthScan(images=24, steps=2),
        DynamicScene(scenes=30),
        GhostImaging(images=4, patterns=24),
    ],
    ids=lambda protocol: protocol.name,
)
def test_nothing_is_recorded_without_light(log: Any, protocol: Measurement[Any], broken: dict[str, float]) -> None:
    station = Station(wiring=WiringSection(burst=True), sim=SimSection(parameters=broken))
    inputs = inputs_for(protocol)
    with opened(station, log) as found, pytest.raises(InstrumentError, match="no light"):
        next(protocol.acquire(found.bench, inputs, protocol.parts(found.bench, inputs)))


def test_a_laser_that_only_says_so(log: Any) -> None:
    dark = Fault("obeys and answers, and emits nothing", happens=lambda laser: laser.world.emit(None), lasting=True)
    protocol = ImageReadout(images=40)
    inputs = images_for(protocol)
    with FaultyBench([Befalling("laser", dark, Moment())]) as broken:
        addresses: dict[str, dict[str, Any]] = {
            role: {"address": found["socket"]} for role, found in broken.resources.items()
        }
        addresses["laser"] |= {"commands": "simulated", "armed": True}
        with opened(Station.model_validate(addresses), log) as found, pytest.raises(InstrumentError, match="no light"):
            next(protocol.acquire(found.bench, inputs, protocol.parts(found.bench, inputs)))
