"""The protocol on a simulated bench: ranges, passes, order of commands."""

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from instruments.bench import Bench
from labctl.bench.opening import opened
from labctl.bench.station import SimSection, Station, read_station
from labctl.engine.inputs import images_for
from protocols.base import Part, PassStarted, ProtocolError, Record, ShotKind
from protocols.image_readout import ImageReadout
from protocols.wavelength_scan import WavelengthScan

SMALL = {"images": 40, "reference_every": 20}


@pytest.fixture
def by_state(log: Any) -> Iterator[Bench]:
    """A bench on which what was measured before changes no frame."""
    with opened(Station(sim=SimSection(noise="by-state")), log) as found:
        yield found.bench


def test_five_ports_in_two_passes_with_ranges_that_fit(bench: Bench) -> None:
    protocol = ImageReadout(**SMALL)
    images = images_for(protocol)
    shots = protocol.shots(images)
    events = list(protocol.acquire(bench, images, protocol.parts(bench, images)))
    passes = [event for event in events if isinstance(event, PassStarted)]
    records = [event for event in events if isinstance(event, Record)]
    assert [len(pass_.scalings) for pass_ in passes] == [4, 1]
    assert [record.first for record in records] == [shot.index for shot in (*shots, *shots)]
    images_only = [record for record in records[:44] if shots[record.first].kind is ShotKind.IMAGE]
    codes = np.concatenate([record.frames.codes for record in images_only])
    assert np.all(np.ptp(codes.astype(int), axis=(0, 2)) > 128), "the traces should fill more than half the screen"
    assert np.mean([record.frames.clipped.any() for record in images_only]) < 0.05
    assert bench.laser.settings()["emitting"] == 0


def test_light_reaches_the_fibre_before_the_chip_and_the_ports_behind_it(bench: Bench) -> None:
    protocol = ImageReadout(images=4, ports=(0, 2, 3), window=0.4e-9)
    images = images_for(protocol)
    lit = np.array([shot.kind is not ShotKind.DARK for shot in protocol.shots(images)])
    events = list(protocol.acquire(bench, images, protocol.parts(bench, images)))
    passes = [event for event in events if isinstance(event, PassStarted)]
    for started in passes:
        records = [event for event in events if isinstance(event, Record) and event.pass_ == started.pass_]
        levels = np.concatenate([record.frames.codes for record in records]).mean(axis=2)
        seen = (levels[lit].mean(axis=0) - levels[~lit].mean(axis=0)) * [one.scale_v for one in started.scalings]
        assert np.all(seen > 4e-3), started.pass_.patching


def test_the_laser_is_tuned_once_a_pass_and_patched_before_it_is_measured(bench: Bench, log: Any) -> None:
    protocol = ImageReadout(**SMALL, ports=(2,), wavelengths=(1550.0, 1551.0))
    images = images_for(protocol)
    events = protocol.acquire(bench, images, protocol.parts(bench, images))
    records = [event for event in events if isinstance(event, Record)]
    assert [record.pass_.wavelength_nm for record in records] == [1550.0] * 44 + [1551.0] * 44
    first, second = (np.concatenate([r.frames.codes for r in records[start : start + 40]]) for start in (0, 44))
    assert not np.array_equal(first, second)


@pytest.mark.parametrize("protocol", [WavelengthScan(), ImageReadout(ports=(2,), wavelengths=(1550.002, 1550.0))])
def test_wavelengths_that_the_laser_never_has_are_refused(
    protocol: WavelengthScan | ImageReadout, tmp_path: Path, log: Any
) -> None:
    """Its read-back is near enough to be no fault of the laser, and too far off to be another step."""
    table = (files("sim_backends.virtual.tlg220") / "commands.toml").read_text("utf-8")
    (tmp_path / "coarse.toml").write_text(table.replace("step = 0.001", "step = 0.02"), "utf-8")
    (tmp_path / "bench.toml").write_text("[laser]\ncommands = 'coarse.toml'\n", "utf-8")
    images = images_for(protocol)
    with opened(read_station(tmp_path / "bench.toml"), log) as found:
        bench = found.bench
        events = protocol.acquire(bench, images, protocol.parts(bench, images))
        with pytest.raises(ProtocolError, match=r"settled at 1550 nm, not at 1550\.002 nm, and .* 2 pm apart: choose"):
            list(events)
        assert bench.laser.settings()["emitting"] == 0


def test_leaving_early_leaves_it_dark(bench: Bench) -> None:
    protocol = ImageReadout(**SMALL)
    images = images_for(protocol)
    events = protocol.acquire(bench, images, protocol.parts(bench, images))
    next(events)
    assert bench.laser.settings()["emitting"] == 1
    events.close()
    assert bench.laser.settings()["emitting"] == 0
    assert bench.awg.settings()["output"] == 0


def test_a_burst_without_its_wiring_is_refused_in_the_dark(bench: Bench, log: Any) -> None:
    protocol = ImageReadout(**SMALL, timing="burst")
    with pytest.raises(ProtocolError, match=r"timing = 'burst' needs wiring\.burst"):
        protocol.check_cabling(bench)
    assert not log.messages


def test_a_run_taken_up_in_the_middle_gives_the_same_frames(by_state: Bench, log: Any) -> None:
    protocol = ImageReadout(**SMALL, averages=4)
    images = images_for(protocol)
    parts = protocol.parts(by_state, images)
    whole = list(protocol.acquire(by_state, images, parts))
    passes = [event for event in whole if isinstance(event, PassStarted)]
    missing = [Part(pass_.pass_, part.shots[-3:], pass_.scalings) for pass_, part in zip(passes, parts, strict=True)]
    log.messages.clear()
    again = list(protocol.acquire(by_state, images, missing))
    assert [event for event in again if isinstance(event, PassStarted)] == passes
    assert len([text for text in log.sent_to("scope") if text == "ACQuire:STATE RUN"]) == 2 * (1 + 3), "no ranging"
    codes = {(r.pass_.index, r.first): r.frames.codes for r in whole if isinstance(r, Record)}
    for record in again:
        if isinstance(record, Record):
            assert np.array_equal(record.frames.codes, codes[record.pass_.index, record.first])
