"""One small run of the simulated bench that several commands look at, and commands as they are typed."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from labctl.main import main

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

    def carry_out(*words: object) -> tuple[int, str, str]:
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        assert isinstance(ended.value.code, int)
        return ended.value.code, *capsys.readouterr()

    return carry_out


@pytest.fixture
def as_json(typed: Typed) -> AsJson:
    """Exit status of one command, and the one JSON object it printed."""

    def carry_out(*words: object) -> tuple[int, dict[str, Any]]:
        status, out, _ = typed(*words, "--json")
        assert out.count("\n") == 1
        found: dict[str, Any] = json.loads(out)
        return status, found

    return carry_out
