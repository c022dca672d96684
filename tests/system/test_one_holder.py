"""Two who want one bench: the second is refused at once in one line, and the first hears nothing of it."""

import json
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from instruments.values import Identity
from labctl.bench.lock import held
from labctl.bench.station import Station
from labctl.errors import BenchInUse
from tests.command_line import as_json, labctl
from tests.system.conftest import LABCTL
from tests.system.waiting import until_stored

RUN = ("run", "image-readout", "--set", "window=0.4 ns")
ENDLESS = ("--set", "images=4000")
REFUSED = re.compile(
    r"^labctl: awg is in use: a run of image-readout, process \d+ of \S+, since \d+ \w+ [\d:]+ UTC"
    r"(, \d+ of \d+ records(, about \d+ s more)?)?: wait for it, or end it: labctl stop \S+\n$"
)


@pytest.fixture
def station(served: tuple[dict[str, Any], Path]) -> Path:
    return served[1]


@contextmanager
def running(station: Path, directory: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A run that has its first shots, killed at the end if it is still there."""
    with subprocess.Popen([*LABCTL, *RUN, *ENDLESS, f"--station={station}", f"--out={directory}"]) as process:
        until_stored(process, directory)
        try:
            yield process
        finally:
            process.kill()


def under_another_name(station: Path) -> Path:
    other = station.with_name("other.toml")
    other.write_text(station.read_text().replace("127.0.0.1", "localhost"))
    return other


@pytest.mark.parametrize("second", [("check",), ("align",), RUN, ("reproduce", "fig3", "--quick")], ids=str)
def test_the_second_is_refused(
    station: Path, tmp_path: Path, second: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    run, out = tmp_path / "run", tmp_path / "out"
    to = () if second[0] == "check" else ("--out", out)
    with running(station, run) as first:
        status, _, said = labctl(capsys, *second, "--station", under_another_name(station), *to)
        assert (status, REFUSED.match(said) is not None) == (1, True), said
        assert str(run) in said
        assert not (out / "manifest.json").exists()
        assert first.poll() is None
        looked_at = labctl(capsys, "runs", tmp_path), labctl(capsys, *RUN, "--dry-run", "--station", station)
        assert [status for status, *_ in looked_at] == [0, 0], looked_at
        first.send_signal(signal.SIGINT)
        assert first.wait() == 130
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    assert {event["event"] for event in events}.isdisjoint({"link lost", "setting changed", "record doubted"})


def test_a_killed_run_lets_go_of_its_bench(station: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with running(station, tmp_path / "run") as first:
        first.kill()
    status, checked = as_json(capsys, "check", "--station", station)
    assert (status, checked["ok"]) == (0, True)
    assert "the supervisor" in (tmp_path / "run" / "commands.log").read_text()


def test_a_killed_group_lets_go_of_its_bench(station: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directory = tmp_path / "run"
    process = subprocess.Popen(
        [*LABCTL, *RUN, *ENDLESS, f"--station={station}", f"--out={directory}"], start_new_session=True
    )
    with process:
        until_stored(process, directory)
        os.killpg(process.pid, signal.SIGKILL)
    assert labctl(capsys, *RUN, "--set", "images=4", "--station", station, "--out", tmp_path / "next")[0] == 0


def test_one_serial_number_at_two_addresses(tmp_path: Path) -> None:
    one, other = (
        Station.model_validate({"scope": {"address": f"TCPIP::192.0.2.{host}::INSTR"}, "laser": {"armed": False}})
        for host in (1, 2)
    )
    scope = Identity("TEKTRONIX", "DPO72504DX", "B019876", "FV:10")
    with held(one, "labctl align") as first, held(other, "labctl check") as second:
        first.identified("scope", scope)
        with pytest.raises(BenchInUse, match=r"^scope is in use: labctl align, process \d+ of .* UTC: wait for it$"):
            second.identified("scope", scope)
        second.identified("scope", Identity("TEKTRONIX", "DPO72504DX", "B019877", "FV:10"))
    with held(other, "labctl check") as second:
        second.identified("scope", scope)
