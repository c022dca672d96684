"""A simulated bench behind real sockets, opened with the project's own drivers: what most tests stand on."""

from collections.abc import Iterator

import pytest

from instruments.bench import Bench
from labctl.opening import OpenBench, opened
from labctl.station import Station
from sim_backends.bench import SimulatedBench
from tests.supervisors import none_left


class MessageLog:
    """Keeps what went over every link."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, str, str]] = []

    def __call__(self, instrument: str, direction: str, message: str) -> None:
        self.messages.append((instrument, direction, message))

    def sent_to(self, instrument: str) -> list[str]:
        return [text for name, direction, text in self.messages if (name, direction) == (instrument, ">")]


@pytest.fixture(autouse=True)
def no_supervisor_outlives_its_test() -> Iterator[None]:
    with none_left():
        yield


@pytest.fixture
def log() -> MessageLog:
    return MessageLog()


@pytest.fixture
def open_bench(log: MessageLog) -> Iterator[OpenBench]:
    with opened(Station(), log) as found:
        yield found


@pytest.fixture
def bench(open_bench: OpenBench) -> Bench:
    return open_bench.bench


@pytest.fixture
def simulation(open_bench: OpenBench) -> SimulatedBench:
    assert open_bench.simulation is not None
    return open_bench.simulation
