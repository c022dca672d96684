"""Hardware-timed bursts."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.errors import InstrumentError, NoTrigger
from instruments.tektronix_awg70002a import TriggerInput
from instruments.values import Frames
from labctl.bench.opening import opened
from labctl.bench.station import Station, WiringSection
from labctl.engine.inputs import images_for
from labctl.runs.live.logs import CommandLog
from protocols.base import Part, PassStarted, ProtocolError, Record, ShotKind
from protocols.bursts import check_times, stretches
from protocols.image_readout import ImageReadout

SMALL = {"images": 40, "reference_every": 20}
ABOVE_ANY_PULSE_V = 4.0
"""A trigger level that the frame sync never crosses: the AWG sees as much of it as with its cable out."""


@pytest.fixture
def wired() -> Iterator[Bench]:
    """A bench whose DMD triggers the AWG."""
    with CommandLog() as log, opened(Station(wiring=WiringSection(burst=True)), log) as found:
        yield found.bench


def measure(bench: Bench, **settings: Any) -> tuple[list[PassStarted], list[Any], list[Any]]:
    protocol = ImageReadout(**SMALL | settings)
    images = images_for(protocol)
    shots = protocol.shots(images)
    events = list(protocol.acquire(bench, images, protocol.parts(bench, images)))
    return (
        [e for e in events if isinstance(e, PassStarted)],
        [e for e in events if not isinstance(e, PassStarted)],
        [*shots],
    )


def volts(passes: list[PassStarted], codes: dict[int, NDArray[np.integer]]) -> list[NDArray[np.float64]]:
    return [
        np.stack(
            [s.scale_v * codes[pass_.pass_.index][:, n] + s.offset_v for n, s in enumerate(pass_.scalings)], axis=1
        )
        for pass_ in passes
    ]


@pytest.mark.parametrize("averages", [1, 7])
def test_a_burst_sees_what_single_shots_see(wired: Bench, averages: int) -> None:
    often: dict[str, Any] = {"averages": averages, "reference_every": 4}  # two records of a port tell its noise badly
    passes, bursts, shots = measure(wired, timing="burst", **often)
    single_passes, singles, _ = measure(wired, **often)
    assert {record.frames.codes.dtype.name for record in (*bursts, *singles)} == {"int8" if averages == 1 else "int16"}
    assert [len(record.frames) for record in bursts] == [len(shots)] * len(passes)
    assert [len(record.frames) for record in singles] == [1] * len(shots) * len(passes)
    together = volts(passes, {record.pass_.index: record.frames.codes for record in bursts})
    one_by_one = volts(
        single_passes,
        {
            index: np.concatenate([r.frames.codes for r in singles if r.pass_.index == index])
            for index in range(len(single_passes))
        },
    )
    kinds = np.array([shot.kind for shot in shots])
    lit, repeats = kinds == ShotKind.IMAGE, kinds == ShotKind.REFERENCE
    for burst, single in zip(together, one_by_one, strict=True):
        noise = np.std(np.diff(burst[repeats], axis=0))
        assert np.std(burst[lit] - single[lit]) < 2 * noise
        assert np.std(burst[lit]) > 3 * noise
    assert wired.laser.settings()["emitting"] == 0


@pytest.mark.parametrize("window", [100e-9, 250e-9])
def test_the_drive_plays_as_long_as_a_frame_lasts(wired: Bench, window: float) -> None:
    (pass_,), (burst,), shots = measure(wired, timing="burst", ports=(2,), images=4, window=window)
    lit = [shot.index for shot in shots if shot.kind is ShotKind.IMAGE]
    (seen,) = volts([pass_], {0: burst.frames.codes[lit]})
    assert np.std(seen[..., -1000:], axis=-1) == pytest.approx(np.std(seen[..., :1000], axis=-1), rel=0.2)


def test_more_pictures_than_the_memory_holds_go_in_parts(wired: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[int] = []
    load = wired.dmd.load  # type: ignore[attr-defined]

    def counted(mirrors: Any, count: int, **named: Any) -> None:
        loaded.append(count)
        load(mirrors, count, **named)

    monkeypatch.setattr(wired.dmd, "capacity", lambda: 30)
    monkeypatch.setattr(wired.dmd, "load", counted)
    _, bursts, _ = measure(wired, timing="burst", ports=(2, 3, 4, 5, 6))
    assert [(record.pass_.index, record.first, len(record.frames.codes)) for record in bursts] == [
        (0, 0, 30),
        (0, 30, 14),
        (1, 0, 30),
        (1, 30, 14),
    ]
    assert loaded == [30, 14, 30, 14]


def test_the_mean_of_a_bursts_triggers_has_less_noise(wired: Bench) -> None:
    spreads = {}
    for averages in (1, 16):
        passes, bursts, shots = measure(wired, timing="burst", averages=averages, ports=(2, 3, 4, 5))
        dark = np.array([shot.kind for shot in shots]) == ShotKind.DARK
        (seen,) = volts(passes, {0: np.concatenate([record.frames.codes for record in bursts])})
        first, second = seen[dark]
        spreads[averages] = np.std(first - second)
    assert spreads[1] / spreads[16] == pytest.approx(4.0, rel=0.25)


def test_a_burst_of_means_takes_all_the_frames_that_there_is_room_for(
    wired: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wired.scope, "most_frames", lambda: 100)
    _, bursts, _ = measure(wired, timing="burst", ports=(2,), averages=3)
    assert [(record.first, len(record.frames.codes)) for record in bursts] == [(0, 33), (33, 11)]


def test_more_averages_than_the_memory_holds_frames_are_refused(wired: Bench) -> None:
    """Records of 20 us: so few of them fill the memory that no test has to wait for them."""
    with pytest.raises(ProtocolError, match=r"^averages = 64: .* the scope's memory holds 62 frames of this window"):
        measure(wired, timing="burst", ports=(2,), images=4, window=20e-6, averages=64)
    assert wired.laser.settings()["emitting"] == 0


def test_a_burst_is_as_long_as_asked(wired: Bench) -> None:
    _, bursts, _ = measure(wired, timing="burst", ports=(2,), longest_burst=30)
    assert [(record.first, len(record.frames.codes)) for record in bursts] == [(0, 30), (30, 14)]


def burst_at(times: NDArray[np.floating]) -> Frames:
    count = times.size
    return Frames(
        np.zeros((count, 1, 5), np.int8), np.zeros((count, 1)), times.astype(np.float64), np.zeros((count, 1), bool)
    )


def test_a_missing_frame_is_found_by_its_time() -> None:
    period_s = 44e-6
    times = np.arange(10) * period_s
    check_times(burst_at(times), 10, period_s)
    with pytest.raises(InstrumentError, match=r"frame 4 came 88\.0 us after the one before"):
        check_times(burst_at(np.delete(times, 4)), 9, period_s)
    with pytest.raises(InstrumentError, match="9 frames for 10 pictures"):
        check_times(burst_at(times[:9]), 10, period_s)


@given(st.sets(st.integers(0, 60)), st.integers(1, 10))
def test_stretches_are_what_is_there_without_gaps(indices: set[int], longest: int) -> None:
    found = list(stretches(sorted(indices), longest))
    assert [index for stretch in found for index in stretch] == sorted(indices)
    assert all(1 <= len(stretch) <= longest for stretch in found)


def test_only_what_is_missing_is_played(wired: Bench) -> None:
    protocol = ImageReadout(**SMALL, timing="burst", ports=(2,))
    images = images_for(protocol)
    (part,) = protocol.parts(wired, images)
    (pass_, whole) = protocol.acquire(wired, images, [part])
    assert isinstance(pass_, PassStarted)
    assert isinstance(whole, Record)
    missing = Part(part.pass_, [part.shots[index] for index in (3, 4, 5, 20, 42)], pass_.scalings)
    (again, *bursts) = protocol.acquire(wired, images, [missing])
    assert again == pass_
    records = [record for record in bursts if isinstance(record, Record)]
    assert [(record.first, len(record.frames.codes)) for record in records] == [(3, 3), (20, 1), (42, 1)]
    for record in records:
        there = slice(record.first, record.first + len(record.frames.codes))
        assert np.corrcoef(record.frames.codes.ravel(), whole.frames.codes[there].ravel())[0, 1] > 0.9


def test_without_the_dmds_frame_sync_the_cables_are_named(wired: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("instruments.tektronix_dpo72504dx.STALLED_S", 0.05)
    monkeypatch.setattr(TriggerInput, "level_v", ABOVE_ANY_PULSE_V)
    with pytest.raises(NoTrigger) as failure:
        measure(wired, timing="burst", ports=(2,))
    told = str(failure.value)
    assert re.search("took 0 of 44 frames.* DMD frame sync -> AWG trigger input.* AWG marker -> scope AUX", told)
    assert "\n" not in told
    assert wired.laser.settings()["emitting"] == 0
