"""What the pages show of learning, computed in another process, which somebody may kill."""

import multiprocessing
from collections.abc import Callable, Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest

from labctl.bench.station import Station
from labctl.dashboard.learning import Learning
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout
from tests.system.waiting import until

IMAGES = 60


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("runs") / "one"
    acquire(Acquisition(ImageReadout(images=IMAGES, window=0.8e-9, ports=(2,)), Station(), directory))
    return directory


@pytest.fixture
def learning() -> Iterator[Learning]:
    found = Learning(lambda: 0.0)
    yield found
    found.close()


@pytest.fixture
def begun() -> Callable[[], list[BaseProcess]]:
    """The processes that this one has begun since."""
    before = multiprocessing.active_children()
    return lambda: [one for one in multiprocessing.active_children() if one not in before]


def kill(processes: list[BaseProcess]) -> None:
    (process,) = processes
    process.kill()
    process.join()


def test_what_a_killed_process_was_asked_is_computed_by_another_one(
    run: Path, learning: Learning, begun: Callable[[], list[BaseProcess]]
) -> None:
    assert not learning.curve(run, IMAGES, growing=False).images
    kill(begun())
    until(lambda: IMAGES in learning.curve(run, IMAGES, growing=False).images or None)
    kill(begun())
    until(lambda: learning.recognition(run, IMAGES, growing=False))
