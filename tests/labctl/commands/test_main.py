"""Commands as they are typed: what comes out, and how they end."""

import itertools
import json
import shutil
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from instruments.alnair_tlg220 import Tlg220
from instruments.errors import InstrumentError
from instruments.safe_state import UnsafeBench
from instruments.tektronix_dpo72504dx import Dpo72504dx
from labctl.bench.signals import Interruption, StoppedBySignal
from labctl.commands.main import main
from labctl.runs.live.logs import EventLog
from labctl.runs.read.run import open_run
from labctl.studies.demonstration import demonstrate
from labctl.studies.paper.experiments import FOLDER, experiments
from labctl.studies.paper.reproduction import Plan
from labctl.studies.readout_file import load_metadata, load_model, save_model
from tests.command_line import as_json, labctl
from tests.data_sets import require

SMALL = ("--set", "images=40", "--set", "window=0.8 ns")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small run that several tests look at."""
    directory = tmp_path_factory.mktemp("runs") / "small"
    with pytest.raises(SystemExit) as ended:
        main(["run", "image-readout", "--set", "images=80", "--out", str(directory)])
    assert ended.value.code == 0
    return directory


def groups_of(directory: Path) -> list[int]:
    """Which image each image shot of a run shows."""
    with open_run(directory) as opened:
        return [int(group) for group in opened.shots["group"][opened.shots["kind"] == "image"]]


def test_the_command_that_leads_on_from_a_folder_with_a_dash_can_be_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    _, out, _ = labctl(capsys, "run", "image-readout", "--set", "images=4", "--set", "window=0.4 ns", "--out=-dash")
    assert "labctl train ./-dash" in out
    assert labctl(capsys, "show", "./-dash")[0] == 0


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = labctl(capsys, "--help")
    assert status == 0
    for command in (
        "demo",
        "check",
        "run",
        "resume",
        "verify",
        "runs",
        "show",
        "compare",
        "export",
        "train",
        "evaluate",
        "record",
        "replay",
        "data",
        "sim",
    ):
        assert f"  {command}" in out


def test_who_has_seen_the_laser_dark_says_so_once(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directory = shutil.copytree(run, tmp_path / "run")
    with EventLog() as events:
        events.stored_in(directory)
        events.safe_state(UnsafeBench("the laser may still emit", ["laser"]))
    assert labctl(capsys, "dark", directory)[:2] == (0, f"{directory}: the laser is recorded as dark\n")
    status, _, told = labctl(capsys, "dark", directory)
    assert (status, told) == (
        2,
        f"labctl: {directory}: its laser is not reported as emitting: there is nothing to confirm\n",
    )


class TestWrongUse:
    """Exit 2, one line, nothing written, no light."""

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["run"], "Missing argument 'protocol': choose one of dynamic-scene, ghost-imaging, image-readout"),
            (
                ["run", "nothing"],
                "choose one of dynamic-scene, ghost-imaging, image-readout, sequence-readout, wavelength-scan",
            ),
            (["run", "wavelength-scan", "--set", "ports=0,0"], "ports = '0,0': (0, 0) names one twice: list each once"),
            (["run", "image-readout", "--data", "/dev/null"], "--data /dev/null: is no folder: name one that holds"),
            (["run", "image-readout", "--bogus"], "No such option: --bogus"),
            (["fly"], "No such command 'fly'"),
            (["run", "image-readout", "--set", "images=40", "seed=7"], "(seed=7): write --set before each setting"),
            (["run", "image-readout", "--set", "images=many"], "images = 'many'"),
            (["run", "image-readout", "--set", "ports=10"], "port 10 is not patched"),
            (["run", "image-readout", "--set", "dataset=nothing"], "no data set is called 'nothing'"),
            (["run", "image-readout", "--set", "images=100000"], "were asked for, the data set has"),
            (["run", "image-readout", "--station", "nowhere.toml"], "nowhere.toml: cannot be read"),
            (["run", "image-readout", "--station", "/dev/null"], "(it is no regular file): name a station file"),
            (["show", "nowhere"], "nowhere: no such file"),
            (["dark", "nowhere"], "nowhere: no such directory: name the run whose laser you have seen dark"),
            (["sim", "serve", "--twin-seed", "-1"], "Input should be greater than or equal to 0"),
            (["runs", "--limit", "99999999999999999999"], "Input should be less than or equal to"),
            (["queue", "remove", "99999999999999999999"], "Input should be less than or equal to"),
            (["show", ".", "--shots", "9" * 5000], "is not a range of shots"),
            (["train", "nowhere"], "nowhere"),
            (["evaluate", "nowhere.h5", "nowhere"], "nowhere.h5"),
            (["data", "path", "nothing"], "no data set is called"),
        ],
    )
    def test_is_told_in_one_line(
        self,
        arguments: list[str],
        message: str,
        capsys: pytest.CaptureFixture[str],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.chdir(tmp_path)
        status, out, err = labctl(capsys, *arguments)
        assert status == 2
        assert not out
        assert message in err
        assert err.startswith("labctl: ")
        assert err.count("\n") == 1
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize(
        ("station", "message"),
        [
            ("[awg]\ncolour = 'red'", "awg.colour = 'red': unknown key"),
            ("[laser]\npower = '30 V'", "laser.power = '30 V'"),
            ("[laser]\npower = '40 mW'", "laser.power = 40 mW exceeds limits.optical_power = 30 mW"),
            ("mixed = true\n[laser]\naddress = 'TCPIP0::127.0.0.1::9::SOCKET'", "write = '<unknown>'"),
            ("[laser]\ndriver = 'manual-laser'", "key switch is the only interlock"),
            ("[patch_panel]\nports = '2-5'", "port 6 is not patched"),
            ("[wiring]\nburst = false", "needs wiring.burst = true"),
            ("[scope]\nchannels = [1, 1]", "scope.channels = [1, 1]: (1, 1) names one twice"),
            ("[durability]\nseconds = 1e308", "durability.seconds = 1e+308"),
            ("[dmd]\nversion = '9.9'", "dmd.version = '9.9'"),
            ("[sim]\ntwin_seed = -1", "sim.twin_seed = -1"),
        ],
    )
    def test_a_wrong_station_is_named_with_its_file(
        self, station: str, message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        path = tmp_path / "bench.toml"
        path.write_text(station, encoding="utf-8")
        out = tmp_path / "run"
        status, _, err = labctl(
            capsys, "run", "image-readout", *SMALL, "--set", "timing=burst", "--station", path, "--out", out
        )
        assert status == 2
        assert "bench.toml" in err
        assert message in err
        assert err.count("\n") == 1
        assert not out.exists()

    @pytest.mark.parametrize(
        ("protocol", "setting"), [("image-readout", "seed=-1"), ("wavelength-scan", "steps=1000000000")]
    )
    def test_a_setting_that_no_run_can_have_is_named(
        self, protocol: str, setting: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        status, _, err = labctl(capsys, "run", protocol, "--set", setting, "--out", tmp_path / "run")
        assert status == 2
        name, _, value = setting.partition("=")
        assert f"--set: {name} = '{value}'" in err
        assert err.count("\n") == 1
        assert not (tmp_path / "run").exists()

    def test_an_unverified_laser_table_is_named(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        from labctl.bench.simulation import SIMULATED_LASER

        table = tmp_path / "laser.toml"
        table.write_text(SIMULATED_LASER.read_text("utf-8").replace("verified = true", "verified = false"), "utf-8")
        station = tmp_path / "bench.toml"
        station.write_text(f"[laser]\ncommands = '{table}'\n", encoding="utf-8")
        status, _, err = labctl(capsys, "run", "image-readout", *SMALL, "--station", station, "--out", tmp_path / "run")
        assert status == 2
        assert "laser.toml: verified = false" in err

    def test_an_address_that_does_not_answer_ends_in_1(
        self, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        station = tmp_path / "bench.toml"
        station.write_text(
            "mixed = true\n[awg]\naddress = 'TCPIP0::127.0.0.1::9::SOCKET'\ntimeout = '0.5 s'\n", encoding="utf-8"
        )
        out = tmp_path / "run"
        status, _, err = labctl(capsys, "run", "image-readout", *SMALL, "--station", station, "--out", out)
        assert status == 1
        assert "awg at TCPIP0::127.0.0.1::9::SOCKET" in err
        assert not out.exists()
        status, found = as_json(capsys, "check", "--station", station)
        assert status == 1
        assert not found["instruments"]["awg"]["ok"]
        assert found["instruments"]["scope"]["ok"]

    def test_images_of_the_wrong_size(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        path = tmp_path / "large.npz"
        np.savez(path, images=np.ones((8, 800, 800), bool), labels=np.arange(8) % 2)
        out = tmp_path / "run"
        status, _, err = labctl(
            capsys, "run", "image-readout", "--set", f"dataset={path}", "--set", "images=8", "--out", out
        )
        assert status == 2
        assert "800x800 pixels do not fit a DMD of 768x1024" in err
        assert not out.exists()

    def test_a_run_directory_that_exists_is_not_touched(self, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
        before = {path: path.stat().st_mtime_ns for path in run.rglob("*")}
        status, _, err = labctl(capsys, "run", "image-readout", *SMALL, "--out", run)
        assert status == 2
        assert "exists" in err
        assert before == {path: path.stat().st_mtime_ns for path in run.rglob("*")}

    def test_a_debugger_gets_the_traceback(self, capsys: pytest.CaptureFixture[str]) -> None:
        status, _, told = labctl(capsys, "--debug", "run", "nothing")
        assert status == 2
        assert told.startswith("Traceback")
        assert told.splitlines()[-1].startswith("labctl: protocol 'nothing' is not installed")

    @pytest.mark.parametrize("disk_full", [False, True])
    def test_a_failure_that_nobody_expected_is_one_line_and_its_traceback_a_file(
        self, disk_full: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        def fail() -> None:
            raise ZeroDivisionError("nothing\nleft")

        monkeypatch.setattr("labctl.commands.doctor.examine", fail)
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none" if disk_full else tmp_path))
        status, out, err = labctl(capsys, "doctor", "--json")
        assert status == json.loads(out)["exit"] == 1
        assert err.startswith("labctl: ZeroDivisionError: nothing left: labctl did not expect this: ")
        assert err.count("\n") == 1
        if disk_full:
            assert "--debug" in err
        else:
            (kept,) = tmp_path.iterdir()
            assert str(kept) in err
            assert "Traceback" in kept.read_text("utf-8")

    def test_want_of_memory_is_one_line_that_says_what_to_do(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def fail() -> None:
            raise MemoryError

        monkeypatch.setattr("labctl.commands.doctor.examine", fail)
        status, _, err = labctl(capsys, "doctor")
        assert status == 1
        assert err == (
            "labctl: no memory is left: end other programs, or ask for less, such as fewer images or a shorter window\n"
        )

    def test_the_end_of_the_simulated_clock_is_one_line_that_says_what_to_do(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        monkeypatch.setattr("sim_backends.world.world.LONGEST_S", 3.0)
        status, out, err = labctl(capsys, "run", "image-readout", *SMALL, "--out", tmp_path / "run", "--json")
        assert status == json.loads(out)["exit"] == 1
        assert json.loads(out)["error"].endswith("start the simulated bench anew")
        assert "Traceback" not in err

    def test_scripts_get_the_error_as_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        status, found = as_json(capsys, "run", "nothing")
        assert status == found["exit"] == 2
        assert "nothing" in found["error"]


class TestRun:
    def test_a_dry_run_writes_nothing(
        self, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        status, plan = as_json(capsys, "run", "image-readout", *SMALL, "--dry-run")
        assert status == 0
        assert (plan["images"], plan["shots"], plan["passes"]) == (40, 44, 2)
        assert plan["estimated_seconds_on_a_real_bench"] > 1
        assert plan["bytes_needed"] > 10**5
        assert not list(tmp_path.iterdir())

    def test_a_dry_run_of_bursts_is_refused_where_they_are_not_wired(
        self, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        station = tmp_path / "station.toml"
        station.write_text("[wiring]\nburst = false\n", encoding="utf-8")
        for command in (("image-readout", "--set", "timing=burst"), ("dynamic-scene",)):
            status, _, err = labctl(capsys, "run", *command, "--dry-run", "--station", station)
            assert (status, "station.toml" in err, "needs wiring.burst = true" in err) == (2, True, True)

    def test_a_dry_run_tells_what_comes_back_below_half_the_sample_rate(
        self, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        _, plan = as_json(capsys, "run", "image-readout", *SMALL, "--dry-run")
        assert plan["aliasing"].startswith("25 GS/s, 25 GHz wide: frequencies above 12.5 GHz fold back below it: set ")
        station = tmp_path / "station.toml"
        station.write_text('[scope]\nbandwidth = "12.5 GHz"\n', encoding="utf-8")
        _, plan = as_json(capsys, "run", "image-readout", *SMALL, "--dry-run", "--station", str(station))
        assert "aliasing" not in plan
        run = ("run", "image-readout", *SMALL, "--station", str(station), "--out", str(tmp_path / "run"))
        assert as_json(capsys, *run)[0] == 0
        sent = (tmp_path / "run" / "commands.log").read_text(encoding="utf-8")
        assert "CH1:BANdwidth 1.250E+10" in sent

    def test_a_mean_of_triggers_takes_a_real_bench_longer(self, capsys: pytest.CaptureFixture[str]) -> None:
        one, several = (
            as_json(capsys, "run", "image-readout", *SMALL, "--dry-run", "--set", f"averages={averages}")[1]
            for averages in (1, 16)
        )
        key = "estimated_seconds_on_a_real_bench"
        assert several[key] - one[key] > 0.35 * one["shots"] * one["passes"], "FastFrame needs 400 ms to get ready"

    def test_a_dry_run_counts_every_burst(self, capsys: pytest.CaptureFixture[str]) -> None:
        burst = ("run", "image-readout", *SMALL, "--set", "timing=burst", "--dry-run")
        one, many = (as_json(capsys, *burst, "--set", f"longest_burst={shots}")[1] for shots in (44, 2))
        more = 21 * one["passes"]
        key = "estimated_seconds_on_a_real_bench"
        assert many[key] - one[key] == pytest.approx(0.45 * more), "FastFrame gets ready and four channels are read"
        assert many["dose_j"] > 2 * one["dose_j"]
        assert many["bytes_needed"] - one["bytes_needed"] > 4096 * (more - 4), "each burst is a file"

    def test_a_profile_accounts_for_the_time(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        status, found = as_json(capsys, "run", "image-readout", *SMALL, "--profile", "--out", tmp_path / "run")
        assert status == 0
        budget = found["profile_ms_per_shot"]
        assert list(budget) == ["upload", "dmd", "arm", "trigger", "physics", "transfer", "comparison", "storage"]
        assert all(spent > 0 for spent in budget.values())
        assert sum(budget.values()) <= 1.3e3 * found["seconds"] / found["shots"]

    def test_averages_are_stored_as_sixteen_bits(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        arguments = ("run", "image-readout", "--set", "images=20", "--set", "averages=4", "--out", tmp_path / "run")
        assert labctl(capsys, *arguments)[0] == 0
        with h5py.File(tmp_path / "run" / "data.h5") as file:
            assert file["frames"].dtype == np.int16

    def test_several_wavelengths_stand_side_by_side(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        settings = ("--set", "images=20", "--set", "ports=2", "--set", "wavelengths=1550 nm,1551 nm")
        assert labctl(capsys, "run", "image-readout", *settings, "--out", tmp_path / "run")[0] == 0
        with h5py.File(tmp_path / "run" / "data.h5") as file:
            assert file["ports"][:].tolist() == [2, 2]
            assert file["wavelength_of_port"][:].tolist() == [1550.0, 1551.0]

    def test_the_data_file_is_plain_hdf5(self, run: Path) -> None:
        with h5py.File(run / "data.h5") as file:
            frames, scale, offset = (file[name][:] for name in ("frames", "scale", "offset"))
            volts = scale[:, None] * frames + offset[:, None]
            assert volts.shape == (88, 5, 50)
            assert file["time"][1] == pytest.approx(40e-12)
            kinds = file["shots"]["kind"]
            assert set(kinds) == {b"image", b"reference", b"dark"}
            dark = file["frames"][:][kinds == b"dark"]
            lit = file["frames"][:][kinds == b"image"]
            assert dark.std() < lit.std() / 3

    def test_every_message_is_in_the_command_log_once_and_every_block(self, run: Path) -> None:
        lines = (run / "commands.log").read_text().splitlines()
        assert any("> awg WLISt:WAVeform:DATA" in line and "crc32" in line for line in lines)
        assert sum("> scope DATa:SOUrce" in line and line.endswith("CURVe?") for line in lines) < 88 * 5 / 2
        referred_to = [line.split(": ")[-1].split("; ") for line in lines if " = run " in line]
        digests = sum(len(blocks.split()) for rounds in referred_to for blocks in rounds)
        assert digests + sum("crc32" in line for line in lines) > 88 * (5 + 2), "curves, and a picture on each pass"
        last = [line.split(" ", 3)[2:] for line in lines if " > " in line]
        assert ["laser", "OUTPUT OFF"] in last[-40:]

    def test_the_manifest_says_where_it_came_from(self, run: Path) -> None:
        manifest = json.loads((run / "manifest.json").read_text())
        assert manifest["protocol"]["settings"]["images"] == 80
        assert manifest["instruments"]["scope"]["identity"]["model"] == "DPO72504DX"
        assert manifest["seeds"] == {"seed": 1, "twin_seed": 1}
        assert manifest["versions"]["numpy"]


class TestLooking:
    def test_runs_are_listed(self, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
        status, found = as_json(capsys, "runs", run.parent)
        assert status == 0
        assert [(row["run"], row["complete"]) for row in found["runs"]] == [(str(run), True)]
        assert "small" in labctl(capsys, "runs", run.parent)[1]

    def test_an_empty_folder_says_so(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        assert "no runs yet" in labctl(capsys, "runs", tmp_path)[1]

    def test_a_run_is_shown(self, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
        status, found = as_json(capsys, "show", run)
        assert status == 0
        assert found["kinds"] == {"dark": 4, "image": 80, "reference": 4}
        assert found["ports"] == [2, 3, 4, 5, 6]
        assert "frames_sha256" in labctl(capsys, "show", run / "data.h5")[1]

    def test_data_sets_are_listed_and_verified(self, capsys: pytest.CaptureFixture[str]) -> None:
        status, found = as_json(capsys, "data", "list")
        assert status == 0
        assert "mnist-0-3" in {card["name"] for card in found["datasets"]}
        status, found = as_json(capsys, "data", "verify", "mnist-0-3")
        assert (status, found["ok"]) == (0, True)
        assert "mnist-0-3" in labctl(capsys, "data", "path", "mnist-0-3")[1]
        assert "CC BY-SA" in labctl(capsys, "data", "list")[1]

    def test_check_prints_a_table(self, capsys: pytest.CaptureFixture[str]) -> None:
        status, out, _ = labctl(capsys, "check")
        assert status == 0
        assert out.count("self-test passed") == 4


def test_a_demonstration_is_an_object_for_scripts_and_a_table_for_people(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At a small size; `make demo` runs the whole."""
    text = (FOLDER / "demonstration.toml").read_text("utf-8")
    small = text.replace("images = 1000", "images = 40").replace("twins = 5", "twins = 1")
    (tmp_path / "demonstration.toml").write_text(small, encoding="utf-8")
    monkeypatch.setattr("labctl.studies.paper.experiments.experiments", partial(experiments, folder=tmp_path))
    status, found = as_json(capsys, "demo", "--out", tmp_path, "--first-seed", 3)
    keys = {"experiment", "shots", "shots_per_second", "accuracy", "accuracy_without_reservoir", "paper", "passed"}
    assert keys | {"run", "seconds"} <= found.keys()
    assert (status, found["passed"]) == (0, True), "one bench decides nothing"
    assert (found["first_seed"], found["twins"], found["open"]) == (3, 1, 6)
    assert (
        {"mean", "sd", "low", "high"} <= found["accuracy"]["0.4"].keys() == found["averaged"]["accuracy"]["0.4"].keys()
    )

    monkeypatch.setattr("labctl.studies.demonstration.demonstrate", lambda *_, **__: found)
    again, out, _ = labctl(capsys, "demo")
    assert again == status
    assert "1 simulated benches (seeds 3 to 3), 10 splits each" in out
    assert "accuracy at 0.4 ns: single triggers open, mean of 16 open" in out
    assert f"report: {found['report']}" in out.replace("\n", "")


def test_a_demonstration_that_is_interrupted_says_what_is_next(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(plan: Plan, *, interruption: Interruption, progress: Any) -> dict[str, Any] | None:
        interruption.requested = True
        return demonstrate(plan, interruption=interruption, progress=progress)

    monkeypatch.setattr("labctl.studies.demonstration.demonstrate", interrupted)
    status, _, err = labctl(capsys, "demo", "--out", tmp_path)
    assert status == 130
    assert f"next: labctl demo begins again, labctl runs {tmp_path} lists what was measured" in err.replace("\n", " ")


class TestReadout:
    def test_trained_evaluated_and_reported(self, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
        status, trained = as_json(capsys, "train", run, "--window", "0.4 ns", "--ports", "2-4")
        assert status == 0
        assert (trained["features"], trained["training_shots"], trained["test_shots"]) == (30, 72, 8)
        status, found = as_json(capsys, "evaluate", trained["model"], run)
        assert status == 0
        assert found["test_shots"] == 8
        assert found["accuracy"] == trained["accuracy"]
        assert found["own_split"] is found["other_images"] is None
        shuffled = found["controls"]["shuffled labels"]
        assert shuffled["at_chance"]
        assert shuffled["accuracy"] <= shuffled["limit"]
        assert shuffled["chance"] < shuffled["limit"]
        told = labctl(capsys, "evaluate", trained["model"], run)[1]
        assert f"at chance: {shuffled['chance']:.3f}, marked above {shuffled['limit']:.3f}" in told
        report = Path(found["report"]).read_text()
        assert "http://" not in report.replace("http://www.w3.org", "")
        assert {path.name for path in (run / "figures").iterdir()} >= {
            f"{name}.{kind}" for name in ("accuracy", "confusion", "traces") for kind in ("png", "svg")
        }
        Path(found["report"]).unlink()
        assert as_json(capsys, "report", run) == (
            0,
            {
                "run": str(run),
                "protocol": "image-readout",
                "report": found["report"],
                "figures": str(run / "figures"),
            },
        )
        assert Path(found["report"]).read_text() == report
        status, shown = as_json(capsys, "show", trained["model"])
        assert shown["ports"] == [2, 3, 4]
        assert "controls" not in labctl(capsys, "evaluate", trained["model"], run)[1]

    def test_it_works_on_other_images_of_the_same_masks_alone(
        self, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        model = as_json(capsys, "train", run, "--out", tmp_path / "model.h5")[1]["model"]
        for setting in ("image_seed=9", "drive_seed=9"):
            options = ("--set", "images=40", "--set", setting, "--out", tmp_path / setting)
            assert as_json(capsys, "run", "image-readout", *options)[0] == 0

        status, found = as_json(capsys, "evaluate", model, tmp_path / "image_seed=9")
        seen = load_metadata(Path(model))["training_groups"]
        assert (status, found["test_shots"]) == (
            0,
            np.isin(groups_of(tmp_path / "image_seed=9"), seen, invert=True).sum(),
        )
        assert found["test_shots"] >= 35
        assert found["interval"][0] > 0.4, "well above chance"
        assert found["controls"]["dark"] is None
        assert "too few such shots" in labctl(capsys, "evaluate", model, tmp_path / "image_seed=9")[1]

        for name, settings in (("few", ("images=8",)), ("one", ("images=40", "classes=3"))):
            words = [word for setting in (*settings, "image_seed=9") for word in ("--set", setting)]
            assert as_json(capsys, "run", "image-readout", *words, "--out", tmp_path / name)[0] == 0
            status, found = as_json(capsys, "evaluate", model, tmp_path / name)
            assert (status, found["random_splits"], found["confusion"]) == (0, None, None)
            assert found["controls"]["shuffled labels"] is None
            assert found["test_shots"] == len(groups_of(tmp_path / name))
            assert found["accuracy"] > 0.4
            report = Path(found["report"]).read_text("utf-8")
            assert f"{100 * found['accuracy']:.1f} %" in report
            assert "Which classes" not in report
            told = labctl(capsys, "evaluate", model, tmp_path / name)[1]
            assert "random splits" in told
            assert "not judged" in told

        status, _, err = labctl(capsys, "evaluate", model, tmp_path / "drive_seed=9")
        assert status == 2
        assert "its drive is not that of this run: measure with --set drive_seed=1, or train anew" in err

    def test_images_it_was_trained_on_are_not_tested_whichever_run_shows_them(
        self, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        trained = as_json(capsys, "train", run, "--out", tmp_path / "model.h5")[1]
        again = ("--set", "images=80", "--set", "reference_every=11", "--out", tmp_path / "again")
        assert as_json(capsys, "run", "image-readout", *again)[0] == 0
        status, found = as_json(capsys, "evaluate", trained["model"], tmp_path / "again")
        assert (status, found["test_shots"]) == (0, trained["test_shots"]) == (0, 8)

        pipeline, metadata = load_model(tmp_path / "model.h5"), load_metadata(tmp_path / "model.h5")
        groups = sorted(groups_of(run))
        earlier = {"frames_sha256": "of a run that was not whole yet", "training_groups": groups[:50]}
        save_model(tmp_path / "model.h5", pipeline, metadata | earlier)
        assert as_json(capsys, "evaluate", trained["model"], run)[1]["test_shots"] == 30
        save_model(tmp_path / "model.h5", pipeline, metadata | {"training_groups": groups})
        status, _, err = labctl(capsys, "evaluate", trained["model"], run)
        assert status == 2
        assert f"was trained on every image of {run}: test it on a run of others" in err

    def test_images_of_another_set_are_named(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        own, digits, model = tmp_path / "own.npz", tmp_path / "digits", tmp_path / "model.h5"
        runs = [digits, tmp_path / "1", tmp_path / "2"]
        for seed, directory in enumerate(runs):
            images = np.random.default_rng(seed).random((60, 8, 8)) < 0.5
            np.savez(own, images=images, labels=np.arange(60) % 3)
            shown = ("images=60", "window=0.16 ns", "ports=2", *([f"dataset={own}"] if directory != digits else []))
            options = [word for setting in shown for word in ("--set", setting)]
            assert as_json(capsys, "run", "image-readout", *options, "--out", directory)[0] == 0
        for trained_on, tested_on, told in (
            (digits, runs[1], f"trained on images of mnist-0-3; this run shows those of {own}"),
            (runs[1], runs[2], f"this run shows those of another set called {own}"),
        ):
            assert as_json(capsys, "train", trained_on, "--window", "0.16 ns", "--out", model)[0] == 0
            assert told in labctl(capsys, "evaluate", model, tested_on)[1]

    def test_identical_images_are_counted(self, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        images, labels = np.random.default_rng(1).random((40, 8, 8)) < 0.5, np.random.default_rng(2).integers(0, 2, 40)
        np.savez(tmp_path / "own.npz", images=images[[*range(40), 3, 3, 5]], labels=labels[[*range(40), 3, 3, 5]])
        options = ("--set", f"dataset={tmp_path / 'own.npz'}", "--set", "images=all", "--out", tmp_path / "own")
        assert as_json(capsys, "run", "image-readout", *options)[0] == 0
        status, trained = as_json(capsys, "train", tmp_path / "own")
        assert (status, trained["identical_images"]) == (0, 5)
        told = "5 images of the run are identical to another one of it: some are tested that a readout was trained on"
        assert told in labctl(capsys, "train", tmp_path / "own")[1]
        assert told in labctl(capsys, "evaluate", trained["model"], tmp_path / "own")[1]
        assert as_json(capsys, "train", run, "--out", tmp_path / "model.h5")[1]["identical_images"] == 0
        assert "identical" not in (run / "manifest.json").read_text(encoding="utf-8")

    def test_a_readout_of_every_second_sample_is_tested_at_times_of_whole_samples(
        self, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        out = ("--out", tmp_path / "model.h5")
        status, trained = as_json(capsys, "train", run, "--search", "tau=80 ps", *out)
        assert (status, trained["tau_s"]) == (0, pytest.approx(80e-12))
        assert as_json(capsys, "evaluate", trained["model"], run)[0] == 0

    def test_a_run_is_followed_shot_by_shot(self, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
        status, found = as_json(capsys, "evaluate", run, "--online", "--ports", "2-5")
        assert status == 0
        assert (found["features"], found["first_shots"], found["judged_shots"], found["last_shots"]) == (40, 20, 60, 15)
        assert found["readouts"].keys() == {"rls", "nlms", "softmax", "ridge"}
        for entry in found["readouts"].values():
            low, high = entry["all"]["interval"]
            assert found["chance"] < low < entry["all"]["accuracy"] < high
            assert len(entry["blocks"]) == len(found["block_ends"])
        assert found["block_ends"][-1] == found["shots"] == 80
        status, out, _ = labctl(capsys, "evaluate", run, "--online", "--window", "0.2 ns")
        assert status == 0
        assert "25 features of 0.2 ns on ports 2, 3, 4, 5, 6; all begin with the first 20 of 80 shots" in out
        assert "the run has 2 passes, one after the other" in out
        assert "recursive least squares" in out

    @pytest.mark.parametrize(
        ("arguments", "told"),
        [
            (["{run}", "{run}", "--online"], "--online trains readouts of its own: name the run directory alone"),
            (["nowhere", "--online"], "nowhere: no such directory"),
            (["{run}", "{run}/models/softmax.h5"], "name the model file first, then the run directory"),
            (["{run}", "--window", "0.4 ns"], "--window and --ports are for --online"),
            (["{run}", "--online", "--ports", "9"], "ports [9] were not recorded"),
        ],
    )
    def test_what_cannot_be_followed_is_refused(
        self, run: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], told: str
    ) -> None:
        status, _, err = labctl(capsys, "evaluate", *(argument.format(run=run) for argument in arguments))
        assert status == 2
        assert told in err

    def test_a_run_of_both_parts_of_a_set_is_judged_by_the_sets_own_split_too(
        self, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        require("mnist")
        run = tmp_path / "run"
        settings = ["dataset=mnist", "images=300", "window=0.4 ns", "timing=burst"]
        options = [word for setting in settings for word in ("--set", setting)]
        assert as_json(capsys, "run", "image-readout", *options, "--out", run)[0] == 0
        status, trained = as_json(capsys, "train", run)
        status, found = as_json(capsys, "evaluate", trained["model"], run)
        assert (status, found["splits"]) == (0, 10)
        assert 0.2 < found["own_split"] <= 1
        assert "the data set's own split" in labctl(capsys, "evaluate", trained["model"], run)[1]

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["--readout", "psychic"], "--readout psychic"),
            (["--window", "3"], "--window: '3' has no unit"),
            (["--window", "9 ns"], "9 ns"),
            (["--ports", "2-x"], "--ports: "),
            (["--ports", "9"], "9"),
            (["--window", "0.2 ns", "--search", "window=0.2 ns,0.4 ns"], "--window and --search window=...: both say"),
        ],
    )
    def test_what_cannot_be_trained_is_named(
        self, run: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        status, _, err = labctl(capsys, "train", run, *options)
        assert status == 2
        assert message in err
        assert err.count("\n") == 1


def test_a_readout_replaces_no_other_file(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(run, tmp_path / "run")
    manifest = tmp_path / "run" / "manifest.json"
    before = manifest.read_bytes()
    for search in ((), ("--search", "C=1,10")):
        status, _, told = labctl(capsys, "train", tmp_path / "run", "--out", manifest, *search)
        assert (status, told) == (2, f"labctl: --out = {manifest}: is there and is no readout: name another file\n")
    assert manifest.read_bytes() == before
    for _ in range(2):
        assert labctl(capsys, "train", tmp_path / "run", "--out", tmp_path / "model.h5")[0] == 0


def test_nothing_goes_on_where_nothing_was_begun(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")  # of Unix
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, most))
    try:
        status, _, told = labctl(capsys, "run", "image-readout", *SMALL, "--out", tmp_path / "run")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert status == 2
    assert "plan.h5: cannot be written: File too large" in told
    assert "labctl resume" not in told.splitlines()[-1]


class TestFailureAfterFailure:
    """The first error is told first; what the end of the run then failed at follows on a line of its own."""

    @pytest.fixture
    def stick(self, monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
        """The laser obeys no more."""
        close = Tlg220.close

        def refuse(laser: Tlg220) -> None:
            close(laser)
            raise InstrumentError("laser: does not obey")

        def stick() -> None:
            monkeypatch.setattr(Tlg220, "make_safe", refuse)
            monkeypatch.setattr(Tlg220, "close", refuse)

        return stick

    def test_of_an_instrument(
        self,
        capsys: pytest.CaptureFixture[str],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        stick: Callable[[], None],
    ) -> None:
        def fail(_scope: Dpo72504dx) -> None:
            stick()
            raise InstrumentError("scope: on fire")

        monkeypatch.setattr(Dpo72504dx, "wait", fail)
        status, out, told = labctl(capsys, "run", "image-readout", *SMALL, "--out", tmp_path / "run", "--json")
        advice = "the laser may still emit, switch it off by its key switch"
        unsafe = f"the safe state is not confirmed (laser: laser: does not obey): {advice}"
        assert status == 1
        assert told.splitlines() == [
            "labctl: scope: on fire",
            f"labctl: {unsafe}",
            "labctl: laser: does not obey",
            f"labctl: the run can go on: labctl resume {tmp_path / 'run'}",
        ]
        notes = [line.removeprefix("labctl: ") for line in told.splitlines()[1:]]
        assert json.loads(out) == {"error": "scope: on fire", "exit": 1, "notes": notes}

    def test_of_an_operator_who_stops_the_run_at_once(
        self,
        capsys: pytest.CaptureFixture[str],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        stick: Callable[[], None],
    ) -> None:
        def stop(_scope: Dpo72504dx) -> None:
            stick()
            raise StoppedBySignal

        monkeypatch.setattr(Dpo72504dx, "wait", stop)
        following = f"the run can go on: labctl resume {tmp_path / 'run'}"
        status, out, told = labctl(capsys, "run", "image-readout", *SMALL, "--out", tmp_path / "run", "--json")
        assert status == 130
        assert "labctl: the safe state is not confirmed (laser: laser: does not obey)" in told
        assert told.splitlines()[-1] == f"labctl: {following}"
        found = json.loads(out)
        assert (found["error"], found["exit"], found["notes"][-1]) == ("interrupted", 130, following)


def test_who_stops_a_sweep_or_a_resumed_run_at_once_hears_how_to_go_on(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wait, waited = Dpo72504dx.wait, itertools.count(1)

    def stop(scope: Dpo72504dx) -> None:
        if next(waited) % 60 == 0:
            raise StoppedBySignal
        wait(scope)

    monkeypatch.setattr(Dpo72504dx, "wait", stop)
    sweep = tmp_path / "sweep"
    status, _, told = labctl(capsys, "sweep", "image-readout", *SMALL, "--over", "power=10 mW,30 mW", "--out", sweep)
    assert (status, told.splitlines()[-1]) == (130, f"labctl: the sweep can go on: labctl resume {sweep}")

    run = tmp_path / "run"
    options = ("--set", "images=40", "--set", "reference_every=5", "--out", run)
    assert labctl(capsys, "run", "image-readout", *options)[0] == 130
    status, _, told = labctl(capsys, "resume", run)
    assert (status, told.splitlines()[-1]) == (130, f"labctl: the run can go on: labctl resume {run}")
