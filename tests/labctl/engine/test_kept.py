"""One bench through several runs: the same links as long as the station is the same, and never after a failure."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from instruments.bench import Observer
from labctl.bench.lock import held
from labctl.bench.station import Station, read_station, write_addresses
from labctl.engine.kept import KeptBench, kept
from labctl.errors import BenchInUse
from sim_backends.bench import SimulatedBench
from tests.conftest import MessageLog


class Followed(Observer):
    """What a run is told."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def event(self, name: str, **_fields: object) -> None:
        self.told.append(name)


@pytest.fixture
def station(simulation: SimulatedBench, tmp_path: Path) -> Station:
    path = tmp_path / "station.toml"
    write_addresses(path, {name: found["socket"] for name, found in simulation.resources.items()}, Station())
    return read_station(path)


@pytest.fixture
def bench(station: Station) -> Iterator[KeptBench]:
    with kept([station], "a test") as found:
        yield found


def test_runs_share_the_links_and_nothing_of_what_they_hear(bench: KeptBench, station: Station) -> None:
    logs, observers = (MessageLog(), MessageLog()), (Followed(), Followed())
    found = []
    for log, observer in zip(logs, observers, strict=True):
        with bench.opened(station, log, observer=observer) as open_bench:
            found.append(open_bench)
            open_bench.bench.awg.identify()
            open_bench.bench.stop_drive()
    assert found[0] is found[1]
    assert logs[0].messages == logs[1].messages
    assert [one.told for one in observers] == [["drive"], ["drive"]]


def test_another_station_or_a_failure_opens_it_anew(bench: KeptBench, station: Station, log: MessageLog) -> None:
    with bench.opened(station, log) as first:
        pass
    dimmer = station.model_copy(update={"laser": station.laser.model_copy(update={"power": 0.01})})
    with bench.opened(dimmer, log) as second:
        assert second is not first
        assert second.bench.levels.optical_power_w == 0.01
    with pytest.raises(ZeroDivisionError), bench.opened(dimmer, log):
        raise ZeroDivisionError
    with bench.opened(dimmer, log) as third:
        assert third is not second


def test_nobody_else_gets_it_between_two_runs(bench: KeptBench, station: Station, log: MessageLog) -> None:
    with bench.opened(station, log):
        pass
    with pytest.raises(BenchInUse, match="awg is in use: a test"), held(station, "another"):
        pass


def test_a_simulated_bench_is_another_one_for_each_run(log: MessageLog) -> None:
    with kept([Station()], "a test") as bench:
        with bench.opened(Station(), log) as first:
            pass
        with bench.opened(Station(), log) as second:
            assert second is not first
