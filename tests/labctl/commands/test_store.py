"""Runs of a sweep in a store: whole, measured once, judged where they lie."""

import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE, Popen
from threading import Barrier

import fsspec
import numpy as np
import pytest

import labctl
from labctl.commands.main import main
from labctl.runs.verification import verify_run
from tests.command_line import LABCTL
from tests.labctl.commands.conftest import AsJson, Typed
from tests.stores import PASSWORD, Traffic, account, s3, ssh

STORE = "s3://bucket/twins"
SETTINGS = ("--set", "classes=0,1", "--set", "ports=2", "--set", "window=0.4 ns")
OVER = ("--over", "sim.twin_seed=3,4", "--order", "as-given", "--reference-every", "0")
SWEEP = ("sweep", "image-readout", *SETTINGS, *OVER)
TWENTY = ("--set", "images=20")


@pytest.fixture(scope="module")
def bucket(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Traffic]:
    """An empty one; what is kept here of stores, and of what was begun here, is the tests' own."""
    kept = {name: str(tmp_path_factory.mktemp(name)) for name in ("XDG_CACHE_HOME", "XDG_STATE_HOME")}
    with pytest.MonkeyPatch.context() as patch, s3() as (address, traffic):
        for name, value in (account(address) | kept).items():
            patch.setenv(name, value)
        fsspec.filesystem("s3", skip_instance_cache=True).mkdir("bucket")
        yield traffic


@pytest.fixture(scope="module")
def swept(bucket: Traffic, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a sweep whose runs are there."""
    folder = tmp_path_factory.mktemp("swept") / "first"
    with pytest.raises(SystemExit) as ended:
        main([*SWEEP, *TWENTY, "--store", STORE, "--out", str(folder)])
    assert ended.value.code == 0
    return folder


def test_a_run_is_put_there_whole_and_measured_once(swept: Path, tmp_path: Path, as_json: AsJson) -> None:
    fsspec.filesystem("s3", skip_instance_cache=True).rm(f"{STORE}/000-sim.twin_seed=3/manifest.json")
    status, found = as_json(*SWEEP, *TWENTY, "--store", STORE, "--out", tmp_path / "again")
    assert (status, found["complete"], found["measured"]) == (0, 2, 1), "a run without its manifest was cut short"

    status, found = as_json(*SWEEP, "--set", "images=22", "--store", STORE, "--out", tmp_path / "other")
    assert status == 2
    assert "another run is there (protocol.settings.images is 20, not 22): name another place" in found["error"]
    assert not found.get("notes"), "to go on would meet the same"
    assert not (tmp_path / "other").exists()

    assert as_json(*SWEEP, *TWENTY, "--out", tmp_path / "here")[0] == 0
    for name in ("000-sim.twin_seed=3", "001-sim.twin_seed=4"):
        with labctl.open_run(f"{STORE}/{name}") as there, labctl.open_run(tmp_path / "here" / name) as here:
            assert np.array_equal(there.frames.values, here.frames.values)
    judged = [as_json("evaluate", folder)[1]["points"] for folder in (swept, tmp_path / "here")]
    assert judged[0] == judged[1]


def test_a_damaged_run_is_measured_again_once_its_folder_is_removed(
    bucket: Traffic, tmp_path: Path, as_json: AsJson
) -> None:
    store, out = "s3://bucket/damaged", tmp_path / "out"
    assert as_json(*SWEEP, *TWENTY, "--store", store, "--out", out)[0] == 0
    run, system = f"{store}/000-sim.twin_seed=3", fsspec.filesystem("s3", skip_instance_cache=True)
    remedy = "nothing mends it there: remove the folder of its run, and measure it again or copy it there anew"
    whole = system.cat(f"{run}/data.h5")
    system.pipe(f"{run}/data.h5", whole[: len(whole) // 2])
    status, found = as_json("evaluate", out)
    assert status == 2
    assert found["error"].startswith(f"{run}/data.h5: not a whole data file (")
    assert found["error"].endswith(f"; {remedy}")

    system.rm([f"{run}/data.h5", f"{run}/shards/000000.h5"])
    status, found = as_json("evaluate", out)
    assert (status, found["error"]) == (2, f"{run}/shards/000000.h5: cannot be read (no such file): {remedy}")
    for words in (("resume", out), (*SWEEP, *TWENTY, "--store", store, "--out", tmp_path / "again")):
        status, found = as_json(*words)
        assert (status, found["error"]) == (2, f"{run}: is not whole (shards/000000.h5 is missing): {remedy}")
    system.rm(run, recursive=True)
    status, found = as_json("resume", out)
    assert (status, found["complete"], found["measured"]) == (0, 2, 1)
    assert as_json("evaluate", out)[0] == 0


def test_runs_are_looked_at_by_the_folder_of_their_sweep_which_is_one_of_several(
    swept: Path, tmp_path: Path, as_json: AsJson
) -> None:
    one = ("--over", "sim.twin_seed=5", "--reference-every", "0")
    words = ("sweep", "image-readout", *SETTINGS, *one, *TWENTY, "--store", STORE, "--out", tmp_path / "another")
    assert as_json(*words)[0] == 0
    places = [f"{STORE}/000-sim.twin_seed=3", f"{STORE}/001-sim.twin_seed=4"]
    assert [one["run"] for one in as_json("runs", swept, "--sort", "name")[1]["runs"]] == places
    assert [str(found.row.path) for found in labctl.runs("twin_seed = 4", folder=swept)] == places[1:]
    with labctl.open_runs(swept) as runs:
        assert runs["sim.twin_seed"].values.tolist() == [3, 4]


def test_runs_are_put_behind_ssh(swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, as_json: AsJson) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    with ssh(tmp_path) as address:
        there = f"{address.replace(f':{PASSWORD}', '')}{tmp_path}/busy/twins"
        status, found = as_json(*SWEEP, *TWENTY, "--store", there, "--out", tmp_path / "out")
        assert status == 0, found["error"][-300:]
        assert found["complete"] == 2
        assert as_json("evaluate", tmp_path / "out")[1]["points"] == as_json("evaluate", swept)[1]["points"]
        assert as_json("resume", tmp_path / "out")[1]["measured"] == 0


def test_a_run_that_cannot_be_put_is_kept_and_no_bucket_is_made(
    bucket: Traffic, tmp_path: Path, as_json: AsJson
) -> None:
    one = ("--over", "sim.twin_seed=3", "--reference-every", "0")
    status, found = as_json(
        "sweep", "image-readout", *SETTINGS, *one, *TWENTY, "--store", "s3://nobucket/lab", "--out", tmp_path / "out"
    )
    place = "s3://nobucket/lab/000-sim.twin_seed=3"
    assert status == 2
    assert found["error"].startswith(f"{place}: there is no such store (")
    system = fsspec.filesystem("s3", skip_instance_cache=True)
    assert not system.exists("nobucket")

    said = re.match(rf"the run is kept on \S+ in (\S+): copy it to {place},", found["notes"][0])
    assert said is not None
    kept = Path(said[1])
    system.mkdir("nobucket")
    system.put(f"{kept}/", place, recursive=True)
    shutil.rmtree(kept.parent)
    status, found = as_json("resume", tmp_path / "out")
    assert (status, found["complete"], found["measured"]) == (0, 1, 0)


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="runs are side by side where there are two cores")
def test_of_each_run_that_cannot_be_put_it_is_said_where_it_is(
    bucket: Traffic, tmp_path: Path, as_json: AsJson, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = Barrier(2, timeout=60)

    def journal_of_both(request: str) -> bool:
        if found := re.match("PUT .*journal", request) is not None:
            both.wait()
        return found

    monkeypatch.setattr(bucket, "refused", journal_of_both)
    status, found = as_json(*SWEEP, *TWENTY, "--store", "s3://bucket/refused", "--out", tmp_path / "out")
    assert (status, "cannot be written" in found["error"]) == (1, True)
    kept = [Path(said[1]) for note in found["notes"] if (said := re.match(r"the run is kept on \S+ in (\S+): ", note))]
    assert sorted(run.name for run in kept) == ["000-sim.twin_seed=3", "001-sim.twin_seed=4"]
    for run in kept:
        assert verify_run(run).complete
        shutil.rmtree(run.parent)


def test_two_commands_at_once_share_a_folder(tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    commands = [
        Popen([*LABCTL, *SWEEP, *TWENTY, "--store", str(lab), "--out", str(tmp_path / name), "--json"], stdout=PIPE)
        for name in ("first", "second")
    ]
    for command in commands:
        found = json.loads(command.communicate(timeout=120)[0])
        assert command.returncode == 0, found
        assert found["complete"] == 2
    assert sorted(one.name for one in lab.iterdir()) == ["000-sim.twin_seed=3", "001-sim.twin_seed=4"]
    assert all(verify_run(one).complete for one in lab.iterdir())


def test_a_password_that_later_commands_would_lack_is_refused(tmp_path: Path, typed: Typed) -> None:
    """Nothing is even requested: there is no such host."""
    store = f"sftp://ada:{PASSWORD}@nowhere/lab"
    status, out, told = typed(*SWEEP, *TWENTY, "--store", store, "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert told == (
        "labctl: sftp://ada@nowhere/lab: what needs a password in its URL is not found by later commands, as it is "
        "written nowhere: use an SSH key or mount the folder, and leave the password out\n"
    )
    assert not (tmp_path / "out").exists()


def test_a_name_with_nothing_in_it_is_not_the_folder_one_is_in(tmp_path: Path, typed: Typed) -> None:
    told = "labctl: a name is empty: name a folder (the shell may not know its variable)\n"
    assert typed(*SWEEP, *TWENTY, "--store", "", "--out", tmp_path / "out") == (2, "", told)
    assert not (tmp_path / "out").exists()
    for command in ("runs", "show", "resume"):
        assert typed(command, "")[::2] == (2, told)


def test_a_store_in_memory_is_refused(tmp_path: Path, typed: Typed) -> None:
    status, out, told = typed(*SWEEP, *TWENTY, "--store", "memory://lab", "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert told == (
        "labctl: --store = memory://lab: is gone with the process that puts a run there: name a folder, or a store as "
        "s3:// or sftp://\n"
    )
    assert not (tmp_path / "out").exists()


def test_a_strangers_sweep_does_not_say_where_to_look(swept: Path, tmp_path: Path, as_json: AsJson) -> None:
    file = tmp_path / "sweep.json"
    said = (swept / "sweep.json").read_text(encoding="utf-8")
    file.write_text(said.replace(STORE, "s3://theirs/twins"), encoding="utf-8")
    status, found = as_json("evaluate", tmp_path)
    assert status == 2
    assert found["error"] == (
        f"{file}: was not written here, and names s3://theirs/twins for its runs: look at them with "
        "'labctl runs s3://theirs/twins'"
    )
