"""The packages that the how-to guides show plug in and work."""

import json
import os
import re
import socketserver
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable
from pathlib import Path

import jsonschema
import pytest

from labctl.runs.read.run import open_run
from tests.checkout import ROOT

EXAMPLES = ROOT / "docs" / "how-to" / "examples"

Labctl = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def labctl(tmp_path_factory: pytest.TempPathFactory) -> Labctl:
    """The command, where the example package is installed as pip does it."""
    folder = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, *offline, "--target", str(folder), str(EXAMPLES)], check=True)
    paths = os.pathsep.join(filter(None, (str(folder), str(ROOT), os.environ.get("PYTHONPATH", ""))))

    def carry_out(*words: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "labctl", *map(str, words)],
            check=False,
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONPATH": paths},
        )

    return carry_out


def test_a_driver_and_a_protocol_of_ones_own_measure_a_run(labctl: Labctl, tmp_path: Path) -> None:
    station, directory = tmp_path / "station.toml", tmp_path / "run"
    station.write_text('[laser]\ndriver = "band-laser"\n', encoding="utf-8")
    ended = labctl("run", "repeatability", "--set", "repeats=5", "--station", station, "--out", directory)
    assert ended.returncode == 0, ended.stderr
    with open_run(directory) as run:
        assert run.frames.shape[:2] == (5, 4)
        assert run.manifest["station"]["laser"]["band"] == "C"
    commands = (directory / "commands.log").read_text()
    assert "> laser WAVELENGTH 1550.0000" in commands
    assert commands.index("> laser OUTPUT ON") < commands.rindex("> laser OUTPUT OFF")


def test_its_own_key_is_checked_and_sets_its_limits_before_anything_is_sent(labctl: Labctl, tmp_path: Path) -> None:
    station = tmp_path / "bench.toml"
    told = (EXAMPLES / "bench.toml").read_text("utf-8")
    for text, message in (
        (told, f"{station}: 1550 nm are asked for, but the laser of band L tunes over 1566..1610 nm: choose other "),
        (told.replace('"L"', '"X"'), f"{station}: laser.band = 'X': Input should be 'C' or 'L'"),
        (told.replace("band-laser", "manual-laser"), f"{station}: laser.band = 'L': unknown key"),
    ):
        station.write_text(text, encoding="utf-8")
        ended = labctl("run", "repeatability", "--station", station, "--out", tmp_path / "run")
        assert ended.returncode == 2
        assert f"labctl: {message}" in ended.stderr
        assert ended.stderr.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_init_finds_it_and_writes_its_keys(labctl: Labctl, tmp_path: Path) -> None:
    class Laser(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            for _ in self.rfile:
                self.wfile.write(b"ACME,BL-1,B00001,1.0\n")

    with socketserver.TCPServer(("127.0.0.1", 0), Laser) as server:
        threading.Thread(target=server.handle_request).start()
        address = f"TCPIP0::127.0.0.1::{server.server_address[1]}::SOCKET"
        station = tmp_path / "bench.toml"
        ended = labctl("init", station, "--no-search", "--yes", "--address", address)
    assert ended.returncode == 0, ended.stderr
    text = station.read_text("utf-8")
    assert re.search(rf'^driver = "band-laser".*\naddress = "{address}"', text, re.MULTILINE)
    assert '# band = "C"  # Which of its two models it is.' in text


def test_editors_and_labctl_know_it(labctl: Labctl) -> None:
    schema = json.loads(labctl("schema", "station").stdout)
    jsonschema.Draft202012Validator(schema).validate(tomllib.loads((EXAMPLES / "bench.toml").read_text("utf-8")))
    assert "laser of bench-extras" in labctl("doctor").stdout
