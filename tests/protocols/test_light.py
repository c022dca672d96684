"""Is there light? What two records of one picture have in common, and a bench without light records nothing."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from instruments.bench import Bench
from instruments.errors import InstrumentError
from instruments.values import Frames, Timebase
from labctl.bench.opening import opened
from labctl.bench.station import SimSection, Station, WiringSection
from labctl.engine.inputs import images_for, inputs_for
from protocols.base import Measurement
from protocols.ghost_imaging import GhostImaging
from protocols.image_readout import ImageReadout
from protocols.light import MOST_SAMPLES, SURE, InCommon, require_light
from protocols.sequence_readout import SequenceReadout
from protocols.wavelength_scan import WavelengthScan
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import LASER, Fault, Moment
from tests.data_sets import require

CHANNELS, SAMPLES, NOISE = 4, 10, 8.0


@pytest.fixture
def lit(bench: Bench) -> Iterator[Bench]:
    """The laser emits, as in every acquisition: whether there is light is another question."""
    with bench.emitting(1550.0):
        yield bench


def probe(course: Any = 0.0, seed: int = 1) -> Callable[[], Frames]:
    """Frames of a course in noise, always others."""
    generator = np.random.default_rng(seed)

    def frames() -> Frames:
        codes = np.rint(generator.normal(0, NOISE, (1, CHANNELS, SAMPLES)) + course).astype(np.int8)
        return Frames(codes, np.zeros((1, CHANNELS)), np.zeros(1), np.zeros((1, CHANNELS), bool))

    return frames


def shifted(frames: Callable[[], Frames], by: Callable[[], float]) -> Frames:
    """A frame whose level drifts meanwhile."""
    found = frames()
    return replace(found, codes=np.rint(found.codes + by()).astype(np.int8))


def test_noise_is_hardly_ever_taken_for_light() -> None:
    found = []
    for seed in range(2000):
        common, frames = InCommon(), probe(seed=seed)
        common.add(frames(), frames())
        found.append(common.certainty)
    assert np.std(found) == pytest.approx(1, abs=0.15)
    assert np.mean(np.array(found) > 2.3) == pytest.approx(0.011, abs=0.01)
    assert max(found) < SURE + 1


def test_records_that_never_change_have_nothing_in_common() -> None:
    still = Frames(np.full((1, 2, 5), 7, np.int8), np.zeros((1, 2)), np.zeros(1), np.zeros((1, 2), bool))
    common = InCommon()
    common.add(still, still)
    assert common.certainty == 0


def test_light_of_a_fifth_of_the_noise_is_found_in_more_probes(lit: Bench) -> None:
    lit.configure(Timebase(25e9, SAMPLES), (1, 2, 3, 4))
    dark = probe()
    with pytest.raises(InstrumentError, match=r"^bench: no light: probes have nothing in common but noise"):
        require_light(lit, [dark], dark(), dark())
    courses = np.random.default_rng(2).normal(0, NOISE / 5, (10, CHANNELS, SAMPLES))
    for seed in range(10):
        probes = [probe(course, seed) for course in courses]
        require_light(lit, probes, probes[0](), probes[0]())


def test_light_without_a_course_is_brighter_than_a_dark_frame(lit: Bench) -> None:
    lit.configure(Timebase(25e9, SAMPLES), (1, 2, 3, 4))
    dark, drifting = probe(seed=3), iter(range(10**6))
    with pytest.raises(InstrumentError, match=r"^bench: no light"):
        require_light(lit, [dark], dark(), dark(), dark)
    wander = partial(shifted, dark, lambda: next(drifting) / 1000)
    with pytest.raises(InstrumentError, match=r"^bench: no light"):
        require_light(lit, [wander], wander(), wander(), wander)
    for seed in range(10):
        faint = probe(NOISE / 5, seed)
        require_light(lit, [faint], faint(), faint(), dark)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light is looked for in an eighth of the probes: what is found in more of them is seen above, without a bench."""
    monkeypatch.setattr("protocols.light.MOST_SAMPLES", MOST_SAMPLES // 8)


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize(
    "protocol",
    [
        ImageReadout(images=40),
        ImageReadout(images=40, timing="burst"),
        ImageReadout(images=4, averages=4, ports=(2,)),
        WavelengthScan(images=4, steps=2),
        GhostImaging(images=4, patterns=24),
        SequenceReadout(symbols=50, ports=(2, 3)),
    ],
    ids=lambda protocol: protocol.name,
)
def test_nothing_is_recorded_without_light(log: Any, protocol: Measurement[Any]) -> None:
    station = Station(wiring=WiringSection(burst=True), sim=SimSection(parameters={"fibre_loss_db": 300.0}))
    if isinstance(protocol, SequenceReadout):
        require(protocol.dataset)
    inputs = inputs_for(protocol)
    with opened(station, log) as found, pytest.raises(InstrumentError, match="no light"):
        next(protocol.acquire(found.bench, inputs, protocol.parts(found.bench, inputs)))


@pytest.mark.usefixtures("soon")
def test_mirrors_that_give_no_light(log: Any) -> None:
    protocol = ImageReadout(images=40)
    inputs = images_for(protocol)
    with (
        opened(Station(sim=SimSection(parameters={"mirror_loss_db": 300.0})), log) as found,
        pytest.raises(InstrumentError, match="no light"),
    ):
        next(protocol.acquire(found.bench, inputs, protocol.parts(found.bench, inputs)))


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize(
    ("laser", "said"),
    [
        (
            Fault("obeys and answers, and emits nothing", happens=lambda laser: laser.world.emit(None), lasting=True),
            r"^bench: no light: .*check that the laser emits",
        ),
        (LASER["drops out"], r"^laser: the light went out by itself \(.*\): check interlock and front panel$"),
    ],
    ids=["only says so", "knows"],
)
def test_a_laser_that_is_dark(log: Any, laser: Fault, said: str) -> None:
    protocol = ImageReadout(images=40)
    inputs = images_for(protocol)
    with FaultyBench([Befalling("laser", laser, Moment())]) as broken:
        addresses: dict[str, dict[str, Any]] = {
            role: {"address": found["socket"]} for role, found in broken.resources.items()
        }
        addresses["laser"] |= {"commands": "simulated", "armed": True}
        with opened(Station.model_validate(addresses), log) as found, pytest.raises(InstrumentError, match=said):
            next(protocol.acquire(found.bench, inputs, protocol.parts(found.bench, inputs)))
