"""One small run of the simulated bench that several commands look at, and commands as they are typed."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from labctl.commands.main import main
from tests import command_line

Typed = Callable[..., tuple[int, str, str]]
AsJson = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture(scope="session")
def bench_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty-four images of two classes on two ports, with two reference images and two dark frames."""
    directory = tmp_path_factory.mktemp("runs") / "measured"
    settings = ("classes=0,1", "images=24", "window=0.4 ns", "ports=2,3", "reference_every=12")
    with pytest.raises(SystemExit) as ended:
        main(["run", "image-readout", *(word for one in settings for word in ("--set", one)), "--out", str(directory)])
    assert ended.value.code == 0
    return directory


@pytest.fixture
def typed(capsys: pytest.CaptureFixture[str]) -> Typed:
    """Exit status, standard output and standard error of one command."""
    return partial(command_line.labctl, capsys)


@pytest.fixture
def as_json(capsys: pytest.CaptureFixture[str]) -> AsJson:
    """Exit status of one command, and the one JSON object it printed."""
    return partial(command_line.as_json, capsys)
