"""A simulated bench behind real sockets, opened with the project's own drivers: what most tests stand on."""

from collections.abc import Iterator

import pytest

from instruments.bench import Bench
from labctl import supervision
from labctl.opening import OpenBench, opened
from labctl.station import Station
from sim_backends.bench import SimulatedBench


class MessageLog:
    """Keeps what went over every link."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, str, str]] = []

    def __call__(self, instrument: str, direction: str, message: str) -> None:
        self.messages.append((instrument, direction, message))

    def sent_to(self, instrument: str) -> list[str]:
        return [text for name, direction, text in self.messages if (name, direction) == (instrument, ">")]


@pytest.fixture(autouse=True)
def no_supervisor_outlives_its_test(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """One that goes on trying to reach a laser would find another test's instrument at its address."""
    supervisors: list[supervision._Supervisor] = []
    begin = supervision._Supervisor.__init__

    def kept(self: supervision._Supervisor, *arguments: object) -> None:
        begin(self, *arguments)  # type: ignore[arg-type]
        supervisors.append(self)

    monkeypatch.setattr(supervision._Supervisor, "__init__", kept)
    yield
    for supervisor in supervisors:
        supervisor._process.kill()
        supervisor._process.wait()


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
