"""The simulated bench as a service in a process of its own."""

import json
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.command_line import LABCTL, as_json

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="session")
def labctl_command() -> tuple[str, ...]:
    """The command line that starts labctl in another process."""
    return LABCTL


@pytest.fixture
def labctl(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, dict[str, Any]]]:
    """A command in this process: exit status and the JSON it prints."""
    return partial(as_json, capsys)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[dict[str, Any], Path]]:
    """Resources of `labctl sim serve`, and a station file that points at them."""
    station = tmp_path_factory.mktemp("served") / "station.toml"
    command = [*LABCTL, "sim", "serve", "--json", "--save-station", str(station)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield json.loads(server.stdout.readline())["resources"], station
        server.send_signal(signal.SIGTERM)
        rest, _ = server.communicate(timeout=30)
    assert rest == "", "one JSON object and nothing else"
    assert server.returncode == 0


def without_arm(station: Path, folder: Path) -> Path:
    """A station file in `folder`, like another but that it allows no light."""
    path = folder / "unarmed.toml"
    path.write_text(station.read_text("utf-8").replace("armed = true\n", ""), encoding="utf-8")
    return path


@pytest.fixture
def unarmed(served: tuple[dict[str, Any], Path], tmp_path: Path) -> Path:
    """A station file of the served bench that allows no light."""
    return without_arm(served[1], tmp_path)


@pytest.fixture(scope="module")
def window() -> "Iterator[Browser]":
    """A real browser, for modules that have the extra to drive it."""
    from tests.dashboard.browser import browser

    with browser() as started:
        yield started


@pytest.fixture
def emitting(served: tuple[dict[str, Any], Path]) -> Iterator[Callable[[], bool]]:
    """The laser's own word, over a connection of our own."""
    _, host, port, _ = served[0]["laser"]["socket"].split("::")
    with socket.create_connection((host, int(port)), timeout=10) as link, link.makefile("rb") as lines:

        def ask() -> bool:
            link.sendall(b"OUTPUT?\n")
            return lines.readline().strip() == b"1"

        yield ask
