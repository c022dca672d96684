"""A sweep of real processes on the simulated bench: killed, resumed, opened as one, judged."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from shutil import copytree, rmtree
from typing import Any

import numpy as np
import pytest

import labctl
from labctl.runs.format.layout import RunPaths
from labctl.runs.notes import read_notes
from labctl.runs.sweep import Sweep, places
from tests.command_line import answer
from tests.system.test_controlled import until
from tests.system.waiting import until_stored

OVER = {"window": ("0.4 ns", "1 ns", "2 ns"), "power": ("10 mW", "30 mW")}
SWEEP = [
    "sweep",
    "image-readout",
    *("--set", "images=40"),
    *(word for name, values in OVER.items() for word in ("--over", f"{name}={','.join(values)}")),
    *("--note", "new fibre", "--tag", "good", "--tag", "fig 3", "--star", "--operator", "Ada"),
]

ASKED = {"protocol": "image-readout", "over": {"power": ("10 mW", "30 mW")}, "reference_every": 0}


def run(*words: object) -> tuple[int, dict[str, Any], str]:
    return answer(*words, "--json")


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Killed while it measured its third run, and gone on with."""
    folder = tmp_path_factory.mktemp("sweeps") / "sweep"
    process = subprocess.Popen([sys.executable, "-m", "labctl", *SWEEP, "--out", str(folder)])
    try:
        until_stored(process, folder / places(Sweep(protocol="image-readout", over=OVER))[2][0])
    finally:
        process.kill()
        process.wait()
    status, found, _ = run("resume", folder)
    assert (status, found["runs"], found["complete"]) == (0, 7, 7)
    assert 4 <= found["measured"] <= 5, "what was complete is left as it was"
    return folder


def test_points_are_runs_like_any_other_and_are_found_by_what_was_varied(swept: Path) -> None:
    listed = run("runs", swept, "--where", "power = 0.01")[1]["runs"]
    assert len(listed) == 4, "three points, the first of them twice"
    assert {entry["state"] for entry in listed} == {"complete"}
    assert run("verify", listed[0]["run"])[0] == 0


def test_it_is_verified_as_a_whole_and_one_damaged_run_is_named(swept: Path, tmp_path: Path) -> None:
    status, found, _ = run("verify", swept)
    assert (status, found["intact"], found["planned"]) == (0, True, 7)
    assert [one["complete"] for one in found["runs"]] == [True] * 7
    copy = copytree(swept, tmp_path / "sweep")
    damaged = sorted(copy.glob("*/shards/*.h5"))[0]
    damaged.write_bytes(damaged.read_bytes()[:-1])
    rmtree(sorted(copy.glob("0*"))[-1])
    status, found, _ = run("verify", copy)
    assert (status, found["intact"], found["planned"], len(found["runs"])) == (1, False, 7, 6)
    assert [one["run"] for one in found["runs"] if not one["intact"]] == [str(damaged.parents[1])]


@pytest.mark.parametrize(
    ("protocol", "settings", "axis", "following"),
    [
        ("image-readout", ["images=4"], "window=0.4 ns,0.8 ns", "evaluate"),
        ("wavelength-scan", ["images=4", "steps=2"], "step=0.1 nm,0.2 nm", "runs"),
    ],
)
def test_what_comes_next_is_something_that_works(
    tmp_path: Path, protocol: str, settings: list[str], axis: str, following: str
) -> None:
    chosen = [word for setting in settings for word in ("--set", setting)]
    folder = tmp_path / "sweep"
    status, found, _ = run("sweep", protocol, *chosen, "--over", axis, "--out", folder)
    assert (status, found["next"]) == (0, f"labctl {following} {folder}")


def test_side_by_side_they_have_the_same_frames_and_notes(swept: Path, tmp_path: Path) -> None:
    folder = tmp_path / "side by side"
    status, found, _ = run(*SWEEP, "--scheduler", "local", "--out", folder)
    assert (status, found["runs"], found["complete"], found["measured"]) == (0, 7, 7, 7)
    names = [name for name, _ in places(Sweep(protocol="image-readout", over=OVER))]
    assert sorted(entry.name for entry in folder.glob("0*")) == sorted(names)
    for name in names:
        with labctl.open_run(folder / name) as here, labctl.open_run(swept / name) as there:
            assert np.array_equal(here.frames.values, there.frames.values), name
        assert read_notes(RunPaths(folder / name)).tags == ("fig 3", "good")


def test_one_bench_measures_one_run_after_the_other(tmp_path: Path) -> None:
    station = tmp_path / "bench.toml"
    station.write_text('mixed = true\n[scope]\naddress = "TCPIP0::192.0.2.1::INSTR"\n', encoding="utf-8")
    words = ("sweep", "image-readout", "--over", "window=0.4 ns,1 ns", "--scheduler", "local", "--station", station)
    status, found, _ = run(*words, "--out", tmp_path / "swept")
    assert status == 2
    assert found["error"].endswith("one bench measures one run after the other: leave --scheduler out")
    assert not (tmp_path / "swept").exists()


def test_what_was_said_at_the_start_is_said_once_of_every_run_also_of_those_measured_later(swept: Path) -> None:
    for name, _ in places(Sweep(protocol="image-readout", over=OVER)):
        found = read_notes(RunPaths(swept / name))
        assert ([one.text for one in found.notes], found.tags) == (["new fibre"], ("fig 3", "good"))
        assert (found.star, found.operator, found.problems) == (True, "Ada", ())
    assert len(run("runs", swept, "--where", "tag = good and operator = Ada")[1]["runs"]) == 7


def test_it_is_one_dataset_with_what_was_varied_as_coordinates(swept: Path) -> None:
    with labctl.open_runs(swept) as runs:
        assert (runs.sizes["run"], runs.sizes["shot"], runs.sizes["port"], runs.sizes["time"]) == (7, 44, 5, 50)
        assert sorted(np.unique(runs.power.values).tolist()) == [0.01, 0.03]
        short = runs.volts.isel(run=np.flatnonzero(runs.window.values == 0.4e-9))
        assert np.isnan(short.values[..., 10:]).all()
        assert np.isfinite(short.values[..., :10]).all()
        whole = runs.volts.isel(run=np.flatnonzero(runs.window.values == 2e-9), time=slice(0, 50, 7), port=[1, 3])
        name = str(whole.run.values[0])
        with labctl.open_run(swept / name) as alone:
            assert float(alone.power) == float(whole.power[0])
            np.testing.assert_array_equal(whole.values[0], alone.volts.values[:, [1, 3], ::7])
        bright, dim = (runs.volts.isel(run=runs.power.values == power).mean() for power in (0.03, 0.01))
        assert float(bright) > 1.5 * float(dim)


def test_it_is_judged_point_by_point(swept: Path) -> None:
    status, found, _ = run("evaluate", swept)
    assert (status, found["axes"], len(found["points"])) == (0, ["window", "power"], 7)
    assert len(found["reference"]) == 2
    assert all(one["interval"][0] < one["accuracy"] < one["interval"][1] for one in found["points"])
    assert Path(found["figure"]).stat().st_size > 10_000


def test_how_many_images_is_an_axis_like_any_other(tmp_path: Path) -> None:
    chosen = ("--set", "window=0.4 ns", "--set", "ports=2", "--over", "images=40,80", "--reference-every", "0")
    folder = tmp_path / "sweep"
    assert run("sweep", "image-readout", *chosen, "--out", folder)[0] == 0
    status, found, _ = run("evaluate", folder)
    assert status == 0
    judged = {one["images"]: one["judged_images"] for one in found["points"]}
    assert judged.keys() == {"40", "80"}
    assert all(0.5 < tested / int(shown) < 0.8 for shown, tested in judged.items()), "by one of ten tenths: 65 %"


def test_a_run_that_has_just_begun_keeps_no_other_from_being_judged(swept: Path, tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    shutil.copytree(swept, folder)
    begun = RunPaths(folder / places(Sweep(protocol="image-readout", over=OVER))[1][0])
    begun.data.unlink()
    begun.journal.write_bytes(begun.journal.read_bytes().splitlines(keepends=True)[0])
    status, found, _ = run("evaluate", folder)
    assert (status, len(found["points"])) == (0, 6)
    assert begun.directory.name not in {one["run"] for one in found["points"]}


@pytest.mark.parametrize("asked", ["its run under way", "its folder"])
def test_stop_of_a_run_ends_the_sweep_dark_and_resume_goes_on_with_it(
    asked: str,
    served: tuple[dict[str, Any], Path],
    emitting: Callable[[], bool],
    labctl_command: tuple[str, ...],
    tmp_path: Path,
) -> None:
    folder, over = tmp_path / "sweep", "power=10 mW,30 mW"
    words = ("sweep", "image-readout", "--set", "images=400", "--set", "ports=2", "--over", over, "--json")
    more = ("--reference-every", "0", "--station", served[1], "--out", folder)
    with subprocess.Popen([*labctl_command, *map(str, words + more)], stdout=subprocess.PIPE, text=True) as process:
        until_stored(process, first := folder / places(Sweep.model_validate(ASKED))[0][0])
        assert emitting()
        status, told, _ = run("stop", first if asked == "its run under way" else folder)
        assert (status, told["asked"], told["process"]) == (0, "stop", process.pid)
        out, _ = process.communicate(timeout=60)
    assert (process.returncode, json.loads(out)["complete"], emitting()) == (130, 0, False)
    assert json.loads(out)["next"] == f"labctl resume {folder}"
    assert [one["state"] for one in run("runs", folder)[1]["runs"]] == ["incomplete"], "no other was begun"
    status, told, _ = run("stop", folder)
    assert (status, told["error"]) == (
        2,
        f"{folder}: no process of this machine is writing this run: nothing to stop",
    )
    status, found, _ = run("resume", folder)
    assert (status, found["complete"], found["measured"], emitting()) == (0, 2, 2, False)


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="runs are side by side where there are two cores")
@pytest.mark.parametrize("end", ["stop", "Ctrl-C"])
def test_side_by_side_all_pause_go_on_and_end(end: str, labctl_command: tuple[str, ...], tmp_path: Path) -> None:
    folder, over = tmp_path / "sweep", "power=10 mW,30 mW"
    words = ("--set", "images=4000", "--over", over, "--reference-every", "0", "--scheduler", "local")
    command = [*labctl_command, "sweep", "image-readout", *words, "--out", str(folder), "--json"]
    runs = [folder / name for name, _ in places(Sweep.model_validate(ASKED))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            for run_ in runs:
                until(run_, "progress", process)
            for asked, first, then in (
                ("pause", "run started", "paused"),
                ("go-on", "paused", "going on"),
                ("pause", "going on", "paused"),
            ):
                assert run(asked, folder)[0] == 0
                for run_ in runs:
                    until(run_, then, process, after=first)
            if end == "stop":
                assert run("stop", runs[0])[0] == 0
            else:
                process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (process.returncode, json.loads(out)["complete"]) == (130, 0)


def test_a_sweep_does_not_go_on_as_another_one(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    asked = ("sweep", "image-readout", "--set", "images=4", "--over", "window=0.4 ns,0.8 ns", "--order", "as-given")
    assert run(*asked, "--reference-every", "0", "--out", folder)[0] == 0
    rmtree(folder / "001-window=0.8ns")
    file = folder / "sweep.json"
    said = file.read_text(encoding="utf-8")
    for now, there in (('"images": "5"', '"images": "4"'), ('"0.9 ns"', '"0.8 ns"')):
        file.write_text(said.replace(there, now), encoding="utf-8")
        status, found, _ = run("resume", folder)
        assert (status, found["error"]) == (
            2,
            f"{file}: edited since the sweep was begun: restore it from a copy, or begin a new sweep",
        )
    earlier = json.loads(said) | {"format_version": "1.3"}
    del earlier["sha256"]
    file.write_text(json.dumps(earlier), encoding="utf-8")
    status, found, _ = run("resume", folder)
    assert (status, found["complete"], found["measured"]) == (0, 2, 1)


def test_a_run_whose_process_was_killed_before_the_manifest_is_begun_again(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    asked = ("sweep", "image-readout", "--set", "images=4", "--over", "window=0.4 ns,0.8 ns", "--order", "as-given")
    assert run(*asked, "--reference-every", "0", "--out", folder)[0] == 0
    begun = RunPaths(folder / "001-window=0.8ns")
    plan = begun.plan.read_bytes()
    rmtree(begun.directory)
    begun.shards.mkdir(parents=True)
    begun.plan.write_bytes(plan)
    begun.journal.touch()
    begun.manifest.with_suffix(".json.tmp").write_bytes(b"{")
    status, found, _ = run("resume", folder)
    assert (status, found["complete"], found["measured"]) == (0, 2, 1)
    assert run("verify", folder)[0] == 0


@pytest.mark.parametrize(
    ("where", "kept"),
    [
        ((), "the finished shots are kept"),
        (("--store", "store"), "the finished runs are kept, those under way begin anew"),
    ],
)
def test_ctrl_c_says_what_is_kept(
    where: tuple[str, ...], kept: str, labctl_command: tuple[str, ...], tmp_path: Path
) -> None:
    words = ("sweep", "image-readout", "--set", "images=4000", "--over", "power=10 mW,30 mW", "--scheduler", "local")
    command = [*labctl_command, *words, *where, "--out", "sweep"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not list(tmp_path.glob("*/**/journal.jsonl")):
            with suppress(subprocess.TimeoutExpired):
                process.wait(1e-2)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"interrupted: {kept}, the bench is in the safe state\n" in out


def test_what_is_refused(swept: Path, tmp_path: Path) -> None:
    status, found, _ = run(*SWEEP, "--out", swept)
    assert (status, found["error"]) == (
        2,
        f"{swept}: is not empty: name another --out, or go on with 'labctl resume {swept}'",
    )
    status, found, _ = run("sweep", "image-readout", "--over", "power=3:30:7 mW", "--out", tmp_path / "new")
    assert status == 2
    assert "laser.power = 3 mW is 4.771213 dBm" in found["error"]
    assert not (tmp_path / "new").exists(), "before anything is made"
    status, found, _ = run(*SWEEP, "--tag", "x" * 200, "--out", tmp_path / "new")
    assert (status, "write 1 to 100 characters" in found["error"]) == (2, True)
    assert not (tmp_path / "new").exists()
    status, found, _ = run(*SWEEP, "--set", "window=2 ns", "--out", tmp_path / "new")
    assert (status, found["error"]) == (
        2,
        "window: is varied, and has one value among the settings: leave one of them out",
    )
    assert not (tmp_path / "new").exists()
    status, found, _ = run("sweep", "image-readout")
    assert (status, found["error"][:18]) == (2, "--over is missing:")


def test_the_plan_says_time_bytes_and_dose(tmp_path: Path) -> None:
    status, plan, _ = run(*SWEEP, "--out", tmp_path / "new", "--dry-run")
    assert (status, plan["runs"], len(plan["points"])) == (0, 7, 7)
    assert plan["shots"] == 7 * 44
    power_w = (4 * 0.01 + 3 * 0.03) / 7
    assert plan["dose_j"] == pytest.approx(power_w * plan["estimated_seconds_on_a_real_bench"])
    assert plan["bytes_needed"] > 1e6
    assert not (tmp_path / "new").exists()
