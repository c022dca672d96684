"""Runs that end before they are complete, in processes of their own, and go on with `labctl resume`."""

import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.signals import Interruption
from labctl.bench.station import Station, read_station, write_addresses
from labctl.commands.main import main
from labctl.engine.session import Acquisition, acquire
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.writer import RunWriter
from protocols.registry import read_protocol
from sim_backends.bench import SimulatedBench
from tests import command_line
from tests.observers import Follower
from tests.system.waiting import until_stored

resource = pytest.importorskip("resource")

SHOTS = 14
SOFTWARE = ("image-readout", "--set", "images=10", "--set", "reference_every=5", "--set", "window=0.8 ns")
BURST = (*SOFTWARE, "--set", "timing=burst")

Labctl = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture(scope="module")
def digests(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], str]:
    """Of runs that were never interrupted."""
    found: dict[tuple[str, ...], str] = {}
    for protocol in (SOFTWARE, BURST):
        folder = tmp_path_factory.mktemp("whole")
        directory, station = folder / "run", few_shots_a_shard(folder / "station.toml", 5)
        with pytest.raises(SystemExit):
            main(["run", *protocol, "--station", str(station), "--out", str(directory), "--json"])
        with open_run(directory) as run:
            found[protocol] = run.digest()
    return found


def killed(command: list[str], directory: Path, shards: int) -> None:
    """Carry out `command` until the run's journal has so many lines, then SIGKILL."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        until_stored(process, directory, shards)
        process.kill()
    assert process.returncode == -signal.SIGKILL, "it ended before it could be killed"


def few_shots_a_shard(path: Path, shots: int) -> Path:
    sections = f"[wiring]\nburst = true\n[durability]\nshots = {shots}\n[sim]\nnoise = 'by-state'\n"
    path.write_text(sections, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("protocol", "shots_a_shard", "shards"),
    [
        (SOFTWARE, 5, 0),  # nothing is stored yet
        (SOFTWARE, 5, 1),  # the next shot is the reference image, the picture that ranges are probed with
        (SOFTWARE, 2, 8),  # inside the second pass
        (BURST, 20, 1),  # between the passes
    ],
)
def test_a_killed_run_ends_with_the_frames_of_one_that_was_not(
    protocol: tuple[str, ...],
    shots_a_shard: int,
    shards: int,
    digests: dict[tuple[str, ...], str],
    labctl_command: tuple[str, ...],
    labctl: Labctl,
    tmp_path: Path,
) -> None:
    directory = tmp_path / "run"
    station = few_shots_a_shard(tmp_path / "station.toml", shots_a_shard)
    killed([*labctl_command, "run", *protocol, "--station", str(station), "--out", str(directory)], directory, shards)
    before = verify_run(directory)
    assert before.intact
    assert not before.complete
    status, resumed = labctl("resume", directory)
    assert (status, resumed["complete"], resumed["shots"]) == (0, True, SHOTS)
    assert resumed["frames_sha256"] == digests[protocol]
    after = verify_run(directory)
    assert (after.intact, after.complete, after.data_file, after.suspect) == (True, True, "current", 0)
    assert all(note.endswith("set aside as suspect, measured again") for note in after.notes)
    with open_run(directory) as run:
        assert (run.measured_at_s[1:] > run.measured_at_s[:-1]).all(), "times go on where they were"
        if before.passes[0] in range(1, SHOTS):
            assert run.epoch[0, 0] < run.epoch[-1, 0], "light that was switched on again is another epoch"


def test_a_complete_run_is_left_as_it_is(labctl: Labctl, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directory = tmp_path / "run"
    labctl("run", *SOFTWARE, "--set", "ports=2", "--out", directory)
    before = {path: path.stat().st_mtime_ns for path in directory.rglob("*") if path.is_file()}
    assert command_line.labctl(capsys, "resume", directory)[:2] == (0, f"{directory}: complete already\n")
    assert {path: path.stat().st_mtime_ns for path in directory.rglob("*") if path.is_file()} == before
    (directory / "data.h5").unlink()
    assert labctl("resume", directory)[1]["measured"] == 0
    assert verify_run(directory).data_file == "current"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs prlimit")
def test_a_full_disk_keeps_what_was_stored_and_the_run_goes_on(
    digests: dict[tuple[str, ...], str],
    labctl_command: tuple[str, ...],
    labctl: Labctl,
    tmp_path: Path,
) -> None:
    """No file can grow any more once the first shard is stored."""
    directory = tmp_path / "run"
    station = few_shots_a_shard(tmp_path / "station.toml", 5)
    command = [*labctl_command, "run", *SOFTWARE, "--station", str(station), "--out", str(directory)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        until_stored(process, directory, 1)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (2_000, resource.RLIM_INFINITY))
        _, told = process.communicate(timeout=60)
    assert process.returncode == 2
    assert re.search(rf"labctl: {directory}/shards/00000.\.h5: cannot be written: File too large", told)
    assert "commands.log cannot be written (File too large): it ends here" in told
    assert f"labctl resume {directory}" in told
    assert "Traceback" not in told
    before = verify_run(directory)
    assert before.intact
    assert before.passes[0] + before.suspect >= 5
    status, resumed = labctl("resume", directory)
    assert (status, resumed["frames_sha256"]) == (0, digests[SOFTWARE])


# Only the program ends; the bench below stays and keeps its state.


@pytest.fixture(scope="module")
def simulation() -> Iterator[SimulatedBench]:
    with SimulatedBench(noise="by-state") as bench:
        yield bench


@pytest.fixture(scope="module")
def station(simulation: SimulatedBench, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return station_of(simulation, tmp_path_factory.mktemp("station") / "station.toml")


@pytest.fixture(scope="module")
def stopped(station: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was stopped in its second pass."""
    directory, interruption = tmp_path_factory.mktemp("stopped") / "run", Interruption()

    def stop(done: int, _total: int) -> None:
        interruption.requested = done == SHOTS + 5

    asked = read_protocol("image-readout", [setting for setting in SOFTWARE[1:] if setting != "--set"])
    acquire(Acquisition(asked, read_station(station), directory), interruption=interruption, observer=Follower(stop))
    return directory


@pytest.fixture
def cut(stopped: Path, tmp_path: Path) -> Path:
    return shutil.copytree(stopped, tmp_path / "run")


def test_the_light_that_a_killed_run_left_on_goes_off_first(
    simulation: SimulatedBench, cut: Path, labctl: Labctl, digests: dict[tuple[str, ...], str]
) -> None:
    laser(simulation, "OUTPUT ON")
    status, resumed = labctl("resume", cut)
    assert (status, resumed["frames_sha256"]) == (0, digests[SOFTWARE])
    assert laser(simulation) == "0"
    log = (cut / "commands.log").read_text()
    resumed_log = log[log.index("! run resumed") :]
    assert resumed_log.index("> laser OUTPUT OFF") < resumed_log.index("> laser OUTPUT ON")


def test_two_processes_cannot_write_one_run(cut: Path, labctl: Labctl) -> None:
    with RunWriter.resume(cut):
        status, told = labctl("resume", cut)
    assert status == 2
    assert "another process is writing this run" in told["error"]


def test_changed_settings_are_told_and_nothing_is_lit(
    simulation: SimulatedBench, cut: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    say(simulation, "awg", "CLOCk:JITTer ON")
    status, out, err = command_line.labctl(capsys, "resume", cut, "--json")
    assert status == 2
    assert json.loads(out)["differences"] == [{"setting": "awg settings.jitter_reduction", "then": 0, "now": 1}]
    assert re.fullmatch(r"labctl: .*run: 1 settings are not those that the run was begun with.*\n", err)
    assert laser(simulation) == "0"
    _, shown, _ = command_line.labctl(capsys, "resume", cut)
    say(simulation, "awg", "CLOCk:JITTer OFF")
    assert re.search(r"setting +then +now *\nawg settings.jitter_reduction +0 +1 *\n", shown)


def test_another_fibre_is_noticed_by_the_reference_image(cut: Path, labctl: Labctl, tmp_path: Path) -> None:
    with SimulatedBench(twin_seed=2) as other:
        status, told = labctl("resume", cut, "--station", station_of(other, tmp_path / "other.toml"))
        assert laser(other) == "0"
    assert status == 1
    assert re.search(r"bench: \w+ shot \d+ is not what it was: .* times what noise and drift explain", told["error"])
    assert verify_run(cut).intact


def test_a_station_may_have_new_addresses_and_nothing_else_that_is_new(
    station: Path, cut: Path, labctl: Labctl, tmp_path: Path, digests: dict[tuple[str, ...], str]
) -> None:
    weak = tmp_path / "weak.toml"
    weak.write_text(station.read_text().replace("[laser]", "[laser]\npower = '20 mW'"), encoding="utf-8")
    status, told = labctl("resume", cut, "--station", weak)
    assert (status, told["differences"]) == (2, [{"setting": "station laser.power", "then": 0.03, "now": 0.02}])
    with SimulatedBench(noise="by-state") as moved:
        status, resumed = labctl("resume", cut, "--station", station_of(moved, tmp_path / "moved.toml"))
    assert (status, resumed["frames_sha256"]) == (0, digests[SOFTWARE])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_run_names_the_command_that_goes_on(
    number: signal.Signals,
    station: Path,
    labctl_command: tuple[str, ...],
    labctl: Labctl,
    digests: dict[tuple[str, ...], str],
    tmp_path: Path,
) -> None:
    directory = tmp_path / "run"
    command = [*labctl_command, "run", *SOFTWARE, "--station", str(station), "--out", str(directory)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        until_stored(process, directory, 1)
        process.send_signal(number)
        told, _ = process.communicate(timeout=30)
    assert process.returncode == 130
    (following,) = re.findall(r"labctl resume \S+", told)
    status, resumed = labctl(*shlex.split(following)[1:])
    assert (status, resumed["frames_sha256"]) == (0, digests[SOFTWARE])


def station_of(simulation: SimulatedBench, path: Path) -> Path:
    station = Station.model_validate({"wiring": {"burst": True}, "durability": {"shots": 5}})
    write_addresses(path, {role: found["socket"] for role, found in simulation.resources.items()}, station)
    assert read_station(path).durability.shots == 5
    return path


def laser(simulation: SimulatedBench, command: str = "") -> str:
    """Whether it emits, after `command`."""
    return say(simulation, "laser", command, "OUTPUT?")


def say(simulation: SimulatedBench, name: str, command: str, query: str = "*IDN?") -> str:
    import pyvisa

    address = simulation.resources[name]["socket"]
    instrument: Any = pyvisa.ResourceManager("@py").open_resource(
        address, read_termination="\n", write_termination="\n"
    )
    try:
        if command:
            instrument.write(command)
        return str(instrument.query(query))
    finally:
        instrument.close()
