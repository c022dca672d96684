"""A live view on the served bench: one holder, dark however it ends, and told what to do from elsewhere."""

import fcntl
import json
import os
import pty
import re
import resource
import signal
import socket
import subprocess
import termios
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import labctl as interface
from labctl.dashboard.views import WatchedView
from labctl.runs.format.origin import Origin
from labctl.runs.live.control_file import Word, ask
from labctl.runs.live.events import EventReader
from labctl.runs.live.sight import LIVE, Sight, Wishes, ask_for, read_sight
from tests.command_line import LABCTL, as_json, labctl
from tests.system.test_one_holder import running, under_another_name
from tests.system.waiting import until

REFUSED = re.compile(
    r"^labctl: awg is in use: labctl live, process \d+ of \S+, since \d+ \w+ [\d:]+ UTC: wait for it, "
    r"or end it: labctl stop \S+\n$"
)
PATIENCE_S = 60.0
RUN = ("run", "image-readout", "--set", "images=4")


@pytest.fixture
def station(served: tuple[dict[str, Any], Path]) -> Path:
    return served[1]


@contextmanager
def viewing(station: Path, runs: Path, *more: str) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """A live view that has seen something, killed at the end if it is still there; and its folder."""
    command = [*LABCTL, "live", f"--station={station}", f"--runs={runs}", "--json", *more]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        until(lambda: process.poll() is not None or list((runs / LIVE).glob("*/sight")))
        try:
            yield process, next((runs / LIVE).iterdir())
        finally:
            process.kill()


def become_terminal(descriptor: int) -> None:
    """Of the session of this process."""
    fcntl.ioctl(descriptor, termios.TIOCSCTTY, 0)


def told(directory: Path) -> list[str]:
    return [event.name for event in EventReader(directory / "events.jsonl").read()]


def seen(directory: Path) -> Sight:
    found = read_sight(directory)
    assert found is not None
    return found


def ended(process: subprocess.Popen[str], number: int) -> tuple[int, dict[str, Any]]:
    process.send_signal(number)
    out, _ = process.communicate(timeout=PATIENCE_S)
    return process.returncode, json.loads(out)


def test_it_looks_five_times_a_second_and_more_and_ctrl_c_ends_it_dark(
    station: Path, tmp_path: Path, emitting: Callable[[], bool]
) -> None:
    with viewing(station, tmp_path) as (process, directory):
        assert emitting()
        until(lambda: seen(directory).looks >= 20)
        status, result = ended(process, signal.SIGINT)
    assert status == 0
    assert not emitting()
    assert result["looks_per_second"] >= 5
    assert result["ports"] == [2, 3, 4, 5]
    assert all(0.9 < one <= 1 for one in result["likeness"])
    assert all(peak >= level > 0 for peak, level in zip(result["peak_v"], result["level_v"], strict=True))
    assert told(directory)[-2:] == ["safe state", "stopped"]


def test_a_killed_one_leaves_no_light(station: Path, tmp_path: Path, emitting: Callable[[], bool]) -> None:
    with viewing(station, tmp_path) as (process, directory):
        assert emitting()
        process.kill()
    until(lambda: not emitting())
    until(lambda: "safe state" in told(directory))
    with viewing(station, tmp_path, "--for=0.5 s") as (process, _):
        out, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert [path.name for path in (tmp_path / LIVE).iterdir()] == [Path(json.loads(out)["view"]).name]


def test_a_full_disk_ends_it_dark_in_a_line_that_names_the_file(
    station: Path, tmp_path: Path, emitting: Callable[[], bool]
) -> None:
    command = [*LABCTL, "live", f"--station={station}", f"--runs={tmp_path}"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        until(lambda: process.poll() is not None or list((tmp_path / LIVE).glob("*/sight")))
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (1000, 1000))
        _, told = process.communicate(timeout=PATIENCE_S)
    (directory,) = (tmp_path / LIVE).iterdir()
    assert told.splitlines()[-1].startswith(f"labctl: {directory / 'sight'}: cannot be written (File too large): ")
    assert not emitting()


def test_it_ends_dark_when_its_terminal_is_gone(station: Path, tmp_path: Path, emitting: Callable[[], bool]) -> None:
    with viewing(station, tmp_path) as (process, directory):
        assert emitting()
        process.send_signal(signal.SIGHUP)
        assert process.wait(PATIENCE_S) == 130
    assert not emitting()
    assert told(directory)[-2:] == ["safe state", "stopped"]


def test_it_ends_dark_when_the_window_it_is_shown_in_is_closed(
    station: Path, tmp_path: Path, emitting: Callable[[], bool]
) -> None:
    """Which draws bars, and a drawing that fails must not be in the way of the dark."""
    ours, its = pty.openpty()
    command = [*LABCTL, "live", f"--station={station}", f"--runs={tmp_path}"]
    with subprocess.Popen(
        command, stdin=its, stdout=its, stderr=its, start_new_session=True, preexec_fn=partial(become_terminal, its)
    ) as process:
        os.close(its)
        drawn = b""
        while b"trace " not in drawn:
            drawn += os.read(ours, 4096)
        assert emitting()
        os.close(ours)
        assert process.wait(PATIENCE_S) == 130
    (directory,) = (tmp_path / LIVE).iterdir()
    assert not emitting()
    assert told(directory)[-2:] == ["safe state", "stopped"]


def test_one_that_nobody_looks_at_ends_dark_and_says_so(
    station: Path, tmp_path: Path, emitting: Callable[[], bool]
) -> None:
    with viewing(station, tmp_path, "--unwatched=1 s") as (process, directory):
        out, _ = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, emitting(), json.loads(out)["unwatched"]) == (0, False, True)
    *_, dark, stopped = EventReader(directory / "events.jsonl").read()
    assert (dark.name, stopped.name, stopped.fields["text"]) == ("safe state", "stopped", "nobody has looked for 1 s")


def test_one_that_is_paused_and_left_alone_gives_the_bench_away(station: Path, tmp_path: Path) -> None:
    with viewing(station, tmp_path, "--unwatched=2 s") as (process, directory):
        ask(directory, Word.PAUSE)
        assert process.wait(PATIENCE_S) == 0
    assert told(directory)[-1] == "stopped"


@pytest.mark.parametrize("second", [("check",), ("align",), RUN, ("live",)], ids=str)
def test_who_comes_second_is_refused(
    station: Path, tmp_path: Path, second: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with viewing(station, tmp_path) as (first, directory):
        status, _, said = labctl(capsys, *second, "--station", under_another_name(station))
        assert (status, REFUSED.match(said) is not None) == (1, True), said
        assert str(directory) in said
        assert first.poll() is None
        looks = seen(directory).looks
        until(lambda: seen(directory).looks > looks)
        assert labctl(capsys, "stop", directory)[0] == 0
        assert first.wait(PATIENCE_S) == 0


def test_it_is_refused_during_a_run(station: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with running(station, tmp_path / "run") as first:
        status, _, said = labctl(capsys, "live", "--station", station, "--runs", tmp_path)
        assert status == 1
        assert said.startswith("labctl: awg is in use: a run of image-readout, process ")
        assert said.count("\n") == 1
        assert first.poll() is None
    assert not (tmp_path / LIVE).exists()


def test_it_is_told_from_elsewhere(station: Path, tmp_path: Path, emitting: Callable[[], bool]) -> None:
    with viewing(station, tmp_path) as (process, directory):
        ask(directory, Word.PAUSE)
        until(lambda: "paused" in told(directory))
        assert not emitting()
        ask(directory, Word.GO_ON)
        until(lambda: "going on" in told(directory))
        until(emitting)
        bright = seen(directory).level_v[-1].mean()
        ask_for(directory, Wishes(power="10 mW"))
        until(lambda: seen(directory).level_v[-1].mean() < 0.6 * bright)
        assert len(seen(directory).elapsed_s) < 20, "the course begins anew with another light"
        ask_for(directory, Wishes(power="1 W"))
        until(lambda: "warning" in told(directory))
        assert emitting()
        ask_for(directory, Wishes(power="10 mW", drive=False))
        until(lambda: EventReader(directory / "events.jsonl").read()[-1].fields == {"on": False})
        looks = seen(directory).looks
        ask_for(directory, Wishes(power="10 mW", anew=1))
        until(lambda: seen(directory).looks > looks)
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 130
    assert not emitting()


def test_a_wish_that_is_refused_keeps_no_other_from_being_set(station: Path, tmp_path: Path) -> None:
    with viewing(station, tmp_path) as (_, directory):
        ask_for(directory, Wishes(power="1 W", wavelength="1551 nm", drive=False))
        until(lambda: EventReader(directory / "events.jsonl").read()[-1].fields == {"on": False})
        *_, refused, tuned, _ = EventReader(directory / "events.jsonl").read()
    assert refused.fields["text"].startswith("not set: ")
    assert "laser.power = 1000 mW exceeds" in refused.fields["text"]
    assert (tuned.name, tuned.fields["wavelength_nm"]) == ("tuned", pytest.approx(1551, abs=0.01))


def test_its_looks_a_second_are_of_the_time_it_looks(station: Path, tmp_path: Path) -> None:
    with viewing(station, tmp_path) as (process, directory):
        ask(directory, Word.PAUSE)
        until(lambda: "paused" in told(directory))
        subprocess.run([*LABCTL, "check", f"--station={station}"], capture_output=True, check=False)  # is refused
        ask(directory, Word.GO_ON)
        until(lambda: "going on" in told(directory))
        looks = seen(directory).looks
        until(lambda: seen(directory).looks > looks)
        status, result = ended(process, signal.SIGINT)
    assert status == 0
    at = {one.name: datetime.fromisoformat(one.time) for one in EventReader(directory / "events.jsonl").read()}
    paused_s = (at["going on"] - at["paused"]).total_seconds()
    assert result["looks"] / result["looks_per_second"] < result["seconds"] - 0.9 * paused_s


@pytest.mark.usefixtures("started_anew")
def test_one_whose_supervisor_is_killed_ends_dark_also_with_the_drive_off(
    station: Path, tmp_path: Path, emitting: Callable[[], bool]
) -> None:
    with viewing(station, tmp_path) as (process, directory):
        ask_for(directory, Wishes(drive=False))
        until(lambda: EventReader(directory / "events.jsonl").read()[-1].fields == {"on": False})
        assert emitting()
        supervisor = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()[0]
        os.kill(int(supervisor), signal.SIGKILL)
        assert process.wait(PATIENCE_S) == 1
    assert not emitting()


def test_powers_are_compared_with_the_limit_also_with_the_drive_off(
    station: Path, tmp_path: Path, emitting: Callable[[], bool], served: tuple[dict[str, Any], Path]
) -> None:
    with viewing(station, tmp_path) as (process, directory):
        ask_for(directory, Wishes(drive=False))
        until(lambda: EventReader(directory / "events.jsonl").read()[-1].fields == {"on": False})
        assert emitting()
        _, host, port, _ = served[0]["laser"]["socket"].split("::")
        with socket.create_connection((host, int(port))) as link:
            link.sendall(b"POWER 15\nPOWER?\n")
            assert float(link.recv(64)) == 15
        assert process.wait(PATIENCE_S) == 1
    assert not emitting()


def test_what_is_missing_is_refused_in_one_line(
    station: Path, unarmed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], emitting: Callable[[], bool]
) -> None:
    nobody = tmp_path / "nobody.toml"
    address = re.compile(r'(\[laser\][^[]*?address = )"[^"]*"', re.DOTALL)
    nobody.write_text(address.sub(r'\1""', station.read_text("utf-8")), encoding="utf-8")
    for options, status, words in (
        (("--station", unarmed), 2, "the laser is not armed"),
        (("--station", nobody), 2, "laser.address is empty"),
        (("--station", tmp_path / "none.toml"), 2, "none.toml"),
        (("--station", station, "--ports", "2-9"), 2, "8 ports at once: the bench has 4 channels"),
        (("--station", station, "--ports", "0,2"), 2, "port 0 is measured alone"),
        (("--station", station, "--ports", "2-99"), 2, "the chip has ports 1 to 14"),
        (("--station", station, "--window", "2 km"), 2, "--window"),
        (("--station", station, "--window", "1 s"), 2, "window = 1 s: choose"),
        (("--station", station, "--wavelength", "1310 nm"), 2, "1310 nm are asked for"),
        (("--station", station, "--wavelength", "1566.0016 nm"), 2, "1566.0016 nm are asked for"),
    ):
        found, _, said = labctl(capsys, "live", "--runs", tmp_path, *options)
        assert (found, said.count("\n"), words in said) == (status, 1, True), said
        assert not emitting()


def test_a_simulated_bench_behind_addresses_is_known_by_its_instruments(station: Path, tmp_path: Path) -> None:
    with interface.bench(station) as bench:
        assert bench.capture().origin is Origin.SIMULATED
    with viewing(station, tmp_path) as (_, directory):
        view = WatchedView(directory)
        view.look()
        assert view.origin is Origin.SIMULATED


def test_one_of_another_maker_is_refused_in_the_dark(
    station: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], emitting: Callable[[], bool]
) -> None:
    other = tmp_path / "other.toml"
    other.write_text(station.read_text("utf-8").replace("[scope]", '[scope]\nidentity = "KEYSIGHT"'), encoding="utf-8")
    status, _, said = labctl(capsys, "live", "--runs", tmp_path, "--station", other)
    assert (status, "which scope.identity = 'KEYSIGHT' is not for" in said, emitting()) == (1, True, False)
    assert not (tmp_path / LIVE).exists()


def test_without_a_station_it_is_the_simulated_bench(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, result = as_json(capsys, "live", "--for", "1 s", "--runs", tmp_path, "--ports", "2,3", "--averages", "2")
    assert (status, result["ports"]) == (0, [2, 3])
    assert result["looks"] >= 2
