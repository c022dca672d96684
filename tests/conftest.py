"""A simulated bench behind real sockets, opened with the project's own drivers: what most tests stand on."""

import gc
import os
import signal
from collections.abc import Iterator

# Tests run side by side and have one core each; BLAS threads without a core of their own wait for each other, busily.
# Processes that tests start inherit it.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
# Hundreds of processes begin in tests: not each is to compile all modules anew.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import hypothesis
import pytest
from threadpoolctl import threadpool_limits

from instruments.bench import Bench
from labctl.bench.opening import OpenBench, opened
from labctl.bench.station import Station
from sim_backends.bench import SimulatedBench
from tests import forked_processes as copied
from tests.supervisors import none_left

threadpool_limits(1)  # of a library that a plugin has loaded before

# How long an example takes depends on what else the machine does.
hypothesis.settings.register_profile("labctl", deadline=None)
hypothesis.settings.load_profile("labctl")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All experiments are carried out for the first test of their module: begin with it, and with one worker."""
    items.sort(key=lambda item: item.path.name != "test_every_experiment.py")


@pytest.hookimpl(tryfirst=True)
def pytest_collection() -> None:
    """What is loaded and collected is there for good: it is not looked through again and again while it grows."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Nor is it later, by each `gc.collect()` of a test."""
    gc.freeze()
    gc.enable()


class MessageLog:
    """Keeps what went over every link."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, str, str]] = []

    def __call__(self, instrument: str, direction: str, message: str) -> None:
        self.messages.append((instrument, direction, message))

    def sent_to(self, instrument: str) -> list[str]:
        return [text for name, direction, text in self.messages if (name, direction) == (instrument, ">")]


@pytest.fixture(autouse=True, scope="session")
def nobodys_own_stations(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What labctl remembers of a user is not remembered of who runs the tests."""
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(autouse=True)
def no_supervisor_outlives_its_test() -> Iterator[None]:
    with none_left():
        yield


@pytest.fixture(autouse=True, scope="session")
def closed_terminals_are_heard() -> Iterator[None]:
    """What tests start ends with its terminal, also where the tests themselves are to outlive theirs (`nohup`)."""
    hang_up = getattr(signal, "SIGHUP", None)
    if hang_up is None or signal.getsignal(hang_up) is not signal.SIG_IGN:
        yield
        return
    signal.signal(hang_up, lambda *_: None)  # unlike one that is ignored, it is not handed down to what is started
    yield
    signal.signal(hang_up, signal.SIG_IGN)


@pytest.fixture(autouse=True, scope="session")
def forked_processes(closed_terminals_are_heard: None) -> Iterator[None]:
    """Processes of labctl are there at once, unless a module is about how one starts."""
    with copied.forked():
        yield


@pytest.fixture(scope="module")
def started_anew(forked_processes: None) -> Iterator[None]:
    """For modules about how processes start, what they start, and what they hold."""
    with copied.started_anew():
        yield


@pytest.fixture(scope="module")
def one_core() -> Iterator[None]:
    """For modules of what tasks come to, none of which is about who carries them out: one process, as for one core."""
    with pytest.MonkeyPatch.context() as settings:
        settings.setattr(os, "cpu_count", lambda: 1)
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
