"""Whether a symbol's frame holds light of the next one: sequences alike up to one symbol, on the whole path."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.values import Frames
from labctl.bench.opening import opened
from labctl.bench.station import Station, WiringSection
from labctl.runs.live.logs import CommandLog
from protocols.base import PassStarted, ProtocolError, Record, Sequences
from protocols.sequence_readout import SequenceReadout

SYMBOLS, SHARED, COUNT = 16, 10, 400
"""The first `SHARED` symbols of all sequences are alike, the others are drawn for each."""


@pytest.fixture
def straight() -> Iterator[Bench]:
    """A bench whose light goes straight into the chip."""
    with CommandLog() as log, opened(Station(wiring=WiringSection(projector=False)), log) as found:
        yield found.bench


def measured(bench: Bench, averages: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values (sequences, symbols) and what was seen of them, (sequences, ports, symbols, samples)."""
    generator = np.random.default_rng(1)
    values = generator.uniform(-1, 1, (COUNT, SYMBOLS))
    values[:, :SHARED] = values[0, :SHARED]
    nothing = np.zeros(COUNT, np.int64)
    inputs = Sequences(values, nothing, nothing, np.arange(COUNT))
    protocol = SequenceReadout(averages=averages)
    events = list(protocol.acquire(bench, inputs, protocol.parts(bench, inputs)))
    ports = []
    for pass_ in (event for event in events if isinstance(event, PassStarted)):
        codes = np.concatenate([e.frames.codes for e in events if isinstance(e, Record) and e.pass_ == pass_.pass_])
        ports += [codes[:, place] * scaling.scale_v for place, scaling in enumerate(pass_.scalings)]
    order = [shot.dataset_index for shot in protocol.shots(inputs)]
    frames = np.stack(ports, axis=1)
    return values[order], frames.reshape(COUNT, len(ports), SYMBOLS, -1)


def shorten(fibres: Iterable[int], samples: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have light from some ports of the chip arrive so many samples earlier."""
    connect, capture = Bench.connect, Bench.capture
    earlier: dict[int, int] = {}

    def connected(bench: Bench, patching: Mapping[int, int]) -> None:
        connect(bench, patching)
        earlier.update(enumerate(-samples * (port in fibres) for port in patching.values()))

    def captured(bench: Bench) -> Frames:
        found = capture(bench)
        codes = [np.roll(one, earlier[place], axis=-1) for place, one in enumerate(found.codes.swapaxes(0, 1))]
        return replace(found, codes=np.stack(codes, axis=1))

    monkeypatch.setattr(Bench, "connect", connected)
    monkeypatch.setattr(Bench, "capture", captured)


@pytest.mark.parametrize("averages", [1, 16])
def test_a_symbol_is_the_same_whatever_follows_it(straight: Bench, averages: int) -> None:
    values, frames = measured(straight, averages)
    spread = frames.std(axis=0)
    noise = spread[:, : SHARED - 1].mean(axis=(1, 2))[:, np.newaxis]
    assert np.all(spread[:, SHARED - 1] < 1.3 * noise), "the last shared symbol differs by noise only"
    assert np.all(spread[:, SHARED].max(axis=-1) > 1.5 * noise[:, 0]), "the next one is seen on every port"
    last = frames[:, :, SHARED - 1, -1] - frames[:, :, SHARED - 1, -1].mean(axis=0)
    told = np.stack([np.ones(COUNT), values[:, SHARED], values[:, SHARED] ** 2], axis=1)
    explained = told @ np.linalg.lstsq(told, last, rcond=None)[0]
    share = float(np.mean(explained**2) / np.mean(last**2))
    assert share < 4 * 2 / COUNT, "what noise alone explains, and no more"


@pytest.mark.parametrize("averages", [1, 16])
def test_ports_whose_light_comes_before_that_of_the_first_are_refused(
    straight: Bench, averages: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    shorten(range(9, 14), 7, monkeypatch)
    with pytest.raises(
        ProtocolError, match=r"light of ports 9, 11, 12, 13 arrives 1\d0 ps before .* shortest fibre first"
    ):
        measured(straight, averages)
