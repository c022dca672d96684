"""Runs of other machines: read where they lie, in stores that others' servers serve, and never written to."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from typing import Any

import fsspec
import numpy as np
import pytest

import labctl
from labctl.errors import RunError, UsageError
from labctl.runs.format import store
from labctl.runs.format.store import BLOCK_BYTES, Unreachable, location
from labctl.runs.read.run import open_run
from tests.labctl.commands.conftest import AsJson, Typed
from tests.stores import PASSWORD, Traffic, account, bucket_of, served, ssh, web

BUCKET = "s3://bucket/lab"


@pytest.fixture(scope="module")
def lab(bench_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs: a whole one with a readout, and one of which only shards are there and some are missing."""
    folder = tmp_path_factory.mktemp("lab")
    shutil.copytree(bench_run, folder / "whole")
    labctl.train(folder / "whole", window="0.4 ns")
    shutil.copytree(bench_run, folder / "cut")
    (folder / "cut" / "data.h5").unlink()
    journal = folder / "cut" / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(line for line in lines if b'"shard": 0,' in line))
    return folder


def files_of(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


@pytest.fixture(scope="module")
def bucket(lab: Path) -> Iterator[Traffic]:
    """The same on an S3 of its own."""
    with bucket_of(lab, BUCKET) as traffic:
        yield traffic


@pytest.fixture(autouse=True)
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What is made of runs elsewhere, and known of them, comes into a folder of the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)


def known(found: dict[str, Any]) -> list[Any]:
    return [{key: value for key, value in one.items() if key != "run"} for one in found["runs"]]


def test_a_listing_of_a_store_is_that_of_the_folder(lab: Path, bucket: Traffic, as_json: AsJson) -> None:
    bucket.forget()
    status, found = as_json("runs", BUCKET)
    assert (status, known(found)) == (0, known(as_json("runs", lab)[1]))
    assert {one["run"] for one in found["runs"]} == {f"{BUCKET}/whole", f"{BUCKET}/cut"}
    assert as_json("runs", BUCKET, "--where", "accuracy >= 0")[1]["runs"][0]["run"] == f"{BUCKET}/whole"
    assert [one.row.name for one in labctl.runs("state = incomplete", folder=BUCKET)] == ["cut"]
    assert bucket.writing == []


def test_a_second_listing_reads_no_run_that_is_as_it_was(bucket: Traffic, typed: Typed) -> None:
    typed("runs", BUCKET)
    bucket.forget()
    status, out, _ = typed("runs", BUCKET)
    assert (status, len(bucket.requests)) == (0, 1)
    system = fsspec.filesystem("s3")
    notes = "s3://bucket/lab/cut/notes.jsonl"
    try:
        system.pipe(notes, b'{"no": "line"}\n')
        bucket.forget()
        assert typed("runs", BUCKET)[1] == out
        assert [one for one in bucket.requests if "whole" in one] == []
        assert [one for one in bucket.requests if "cut/notes" in one]
    finally:
        system.rm(notes)


@pytest.mark.parametrize("name", ["whole", "cut"])
def test_a_run_in_a_store_is_what_it_is_here(name: str, lab: Path, bucket: Traffic) -> None:
    bucket.forget()
    with open_run(lab / name) as local, open_run(f"{BUCKET}/{name}") as there:
        assert (there.complete, there.done, there.manifest) == (local.complete, local.done, local.manifest)
        assert there.digest() == local.digest()
        np.testing.assert_array_equal(there.shots, local.shots)
        np.testing.assert_array_equal(there.measured_at_s, local.measured_at_s)
    with labctl.open_run(lab / name) as local, labctl.open_run(f"{BUCKET}/{name}") as there:
        assert there.identical(local.assign_attrs(run=f"{BUCKET}/{name}"))
    assert bucket.writing == []


def test_runs_in_a_store_open_as_one(lab: Path, bucket: Traffic) -> None:
    with labctl.open_runs(BUCKET) as there, labctl.open_runs(lab) as local:
        assert there.identical(local)


def test_of_a_long_run_only_what_is_looked_at_is_requested(lab: Path, bucket: Traffic) -> None:
    import h5py

    size = 8 * BLOCK_BYTES
    with h5py.File(lab.parent / "long.h5", "w") as file:
        file.create_dataset("frames", data=np.arange(size, dtype="u1"), chunks=(1 << 16,))
    fsspec.filesystem("s3").put(str(lab.parent / "long.h5"), "bucket/long.h5")
    bucket.forget()
    with h5py.File(location("s3://bucket/long.h5").own_file(size * 2), "r") as file:  # type: ignore[attr-defined]
        assert file["frames"][5 * BLOCK_BYTES] == 0
    assert bucket.bytes < 4 * BLOCK_BYTES


def test_a_run_in_a_store_is_shown_and_its_pictures_lie_here(bucket: Traffic, tmp_path: Path, as_json: AsJson) -> None:
    bucket.forget()
    status, found = as_json("show", f"{BUCKET}/whole")
    assert (status, found["run"], found["frames_sha256"]) == (0, f"{BUCKET}/whole", None)
    assert found["pictures"][0] == "whole/figures/shown-traces.png"
    assert all((tmp_path / one).is_file() for one in found["pictures"])
    assert bucket.writing == []


def test_a_readout_is_tested_on_a_run_in_a_store(lab: Path, bucket: Traffic, tmp_path: Path, as_json: AsJson) -> None:
    (model,) = (lab / "whole" / "models").iterdir()
    bucket.forget()
    status, found = as_json("evaluate", model, f"{BUCKET}/whole")
    assert (status, found["report"]) == (0, "whole/report.html")
    assert (tmp_path / "whole" / "report.html").is_file()
    assert found["accuracy"] == labctl.evaluate(f"{BUCKET}/whole/models/{model.name}", f"{BUCKET}/whole")["accuracy"]
    assert bucket.writing == []


@pytest.mark.parametrize(
    "words",
    [
        ("resume",),
        ("note", "said"),
        ("verify", "--rebuild"),
        ("verify",),
        ("train",),
        ("report",),
        ("stop",),
        ("dark",),
        ("export", "--to", "npz"),
    ],
    ids=lambda words: words[0],
)
def test_what_writes_or_needs_the_whole_run_refuses_a_url(words: tuple[str, ...], typed: Typed, tmp_path: Path) -> None:
    """Nothing is even requested: there is no such host."""
    command, *rest = words
    status, out, err = typed(command, "s3://nowhere/run", *rest)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "copy it here" in err
    status, _, err = typed(command, f"file://{tmp_path}/run", *rest)
    assert (status, err.count("\n")) == (2, 1)
    assert f"name it by its path, {tmp_path}/run" in err


def test_pages_of_a_store_without_runs_are_refused_before_they_are_served(bucket: Traffic, typed: Typed) -> None:
    status, out, told = typed("dashboard", "s3://bucket/nothing", "--no-open", "--port", "0")
    assert (status, out) == (2, "")
    assert told == "labctl: s3://bucket/nothing: nothing is there: name a folder with runs in it\n"


def test_a_file_url_is_the_folder(lab: Path, as_json: AsJson) -> None:
    assert as_json("runs", f"file://{lab}") == as_json("runs", lab)
    with open_run(f"file://{lab}/cut") as run:
        assert run.path == lab / "cut"


def test_a_run_behind_a_web_server(lab: Path, as_json: AsJson) -> None:
    with web(lab) as (address, traffic):
        status, found = as_json("runs", address)
        assert (status, known(found)) == (0, known(as_json("runs", lab)[1]))
        with open_run(f"{address}/cut") as there, open_run(lab / "cut") as local:
            assert there.digest() == local.digest()
        with open_run(f"{address}/whole/data.h5") as there, open_run(lab / "whole") as local:
            assert there.digest() == local.digest()
        assert traffic.writing == []


def test_a_run_behind_ssh(lab: Path, as_json: AsJson, typed: Typed, tmp_path: Path) -> None:
    with ssh(tmp_path) as address:
        status, found = as_json("runs", f"{address}{lab}")
        assert (status, known(found)) == (0, known(as_json("runs", lab)[1]))
        assert PASSWORD not in json.dumps(found)
        with open_run(f"{address}{lab}/whole") as there, open_run(lab / "whole") as local:
            assert there.digest() == local.digest()
        (lab / "cut" / "extra").symlink_to("/etc/hostname")
        try:
            with pytest.raises(RunError, match=r"cut/extra: is a link or a device"):
                open_run(f"{address}{lab}/cut")
            open_run(f"{address}{lab}/whole").close()
        finally:
            (lab / "cut" / "extra").unlink()
        status, _, err = typed("show", f"{address}{lab}/nothing")
        assert (status, err.count("\n")) == (2, 1)
        assert PASSWORD not in err


@pytest.mark.parametrize("name", [".", "closed"])
def test_a_folder_that_ssh_refuses_to_list_is_not_taken_for_empty(
    name: str, lab: Path, tmp_path: Path, typed: Typed
) -> None:
    shutil.copytree(lab, tmp_path / "runs" / "closed")
    with ssh(tmp_path) as address:
        status, out, err = typed("runs", f"{address}{tmp_path}/runs/{name}".removesuffix("/."))
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert f"{tmp_path}/runs/closed: cannot be read (" in err


@pytest.mark.parametrize("refusal", ["403 Forbidden", "404 Not Found"])
def test_a_folder_that_a_web_server_refuses_to_list_is_not_taken_for_empty(
    refusal: str, lab: Path, typed: Typed
) -> None:
    with web(lab) as (address, traffic):
        traffic.refused, traffic.refusal = (lambda request: "/cut" in request), refusal
        status, out, err = typed("runs", address)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert f"{address}/cut: cannot be read (" in err


def test_a_run_in_memory(lab: Path, typed: Typed) -> None:
    system = fsspec.filesystem("memory")
    for path in files_of(lab / "cut"):
        system.pipe(f"/shelf/{path.relative_to(lab / 'cut')}", path.read_bytes())
    with open_run("memory://shelf") as run:
        assert not run.complete
    system.pipe("/shelf/plan.h5", b"x" * 100)
    assert "damaged" in typed("show", "memory://shelf")[2]
    system.pipe("/shelf/manifest.json", b"x" * (1 << 24))
    status, _, err = typed("show", "memory://shelf")
    assert (status, err.count("\n")) == (2, 1)
    assert "memory://shelf/manifest.json: cannot be read (has 16777216 bytes" in err


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("data.h5", ("show", f"{BUCKET}/whole")),
        ("000000.h5", ("show", f"{BUCKET}/cut")),
        ("manifest", ("runs", BUCKET)),
    ],
)
def test_a_store_that_breaks_off_is_one_line_and_is_not_remembered(
    file: str, words: tuple[str, ...], bucket: Traffic, typed: Typed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bucket, "cut", file)
    status, out, err = typed(*words)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert f"{file}" in err
    assert "cannot be read" in err
    assert "see to the connection" in err
    monkeypatch.setattr(bucket, "cut", "")
    assert "unreadable" not in typed("runs", BUCKET)[1]


def test_a_store_that_is_gone_is_one_line(typed: Typed) -> None:
    with web(Path()) as (address, _):
        pass
    with pytest.raises(Unreachable, match="see to the connection"):
        open_run(f"{address}/run")
    for words in (("runs", address), ("show", f"{address}/run/data.h5")):
        status, out, err = typed(*words)
        assert (status, out, err.count("\n")) == (1, "", 1)
        assert f"{words[1]}: cannot be read (" in err


def test_ssh_that_stands_still_is_one_line(
    lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, typed: Typed
) -> None:
    shutil.copytree(lab, tmp_path / "runs" / "asleep")
    monkeypatch.setattr(store, "SILENT_S", 1)
    monkeypatch.setitem(fsspec.config.conf, "sftp", {"timeout": 60})  # of a user, to connect
    with ssh(tmp_path) as address:
        status, out, err = typed("runs", f"{address}{tmp_path}/runs")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert f"{tmp_path}/runs/asleep: cannot be read (" in err


def test_s3_that_stands_still_is_one_line_after_two_rounds_of_the_users_tries(
    monkeypatch: pytest.MonkeyPatch, typed: Typed
) -> None:
    ended = Event()

    def never(_environ: Any, start_response: Any) -> list[bytes]:
        ended.wait()
        start_response("500 Internal Server Error", [])
        return []

    monkeypatch.setitem(fsspec.config.conf, "s3", {"config_kwargs": {"connect_timeout": 60, "read_timeout": 0.5}})
    with served(never) as (address, traffic):
        for name, value in account(address).items():
            monkeypatch.setenv(name, value)
        try:
            status, out, err = typed("runs", BUCKET)
            assert len(traffic.requests) == 2
        finally:
            ended.set()
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert f"{BUCKET}: cannot be read (" in err


@pytest.mark.parametrize("refusal", ["403 Forbidden", "500 Internal Server Error"])
def test_a_data_file_that_is_refused_is_not_called_missing(refusal: str, lab: Path, typed: Typed) -> None:
    with web(lab) as (address, traffic):
        status, out, err = typed("show", f"{address}/nothing/data.h5")
        assert (status, out, err.count("\n")) == (2, "", 1)
        traffic.refused, traffic.refusal = (lambda _request: True), refusal
        status, out, err = typed("show", f"{address}/whole/data.h5")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert f"{address}/whole/data.h5: cannot be read ({refusal[:3]}" in err


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("s3://bucket/nothing", "nothing is there"),
        ("s3://no-such-bucket/lab", "nothing is there"),
        ("shelf://bucket/lab", "name a store as s3://"),
        ("s3://bucket/../lab", "leads outside of itself"),
    ],
)
def test_what_is_no_place_is_one_line(url: str, words: str, bucket: Traffic, typed: Typed) -> None:
    status, out, err = typed("runs", url)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert words in err


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("sftp://ada:engine@host/lab", "sftp://ada@host/lab"),
        ("sftp://ada:eng@ine@host:22/lab", "sftp://ada@host:22/lab"),
        ("sftp://ada:e:n@g@host/a:b@c", "sftp://ada@host/a:b@c"),
        ("sftp://ada@lab.org:engine@host/lab", "sftp://ada@lab.org@host/lab"),
        ("sftp://ada@host:22/a@b", "sftp://ada@host:22/a@b"),
        ("https://host:8080/ada:engine@lab", "https://host:8080/ada:engine@lab"),
    ],
)
def test_no_part_of_a_password_is_shown(url: str, shown: str) -> None:
    assert str(location(url)) == shown


@pytest.mark.parametrize("url", ["file:///lab/runs", "file://localhost/lab/runs", "local:///lab/runs"])
def test_the_url_of_a_folder_here_is_its_path(url: str) -> None:
    assert location(url) == Path("/lab/runs")


@pytest.mark.parametrize("url", ["file://twins", "file://runs/twins", "local://twins"])
def test_the_url_of_a_folder_here_names_no_machine(url: str) -> None:
    with pytest.raises(UsageError, match=f"^{url}: names a machine: write file:///..., or the path of the folder$"):
        location(url)


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, typed: Typed) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    status, _, err = typed("runs", "s3://bucket/lab")
    assert status == 2
    assert err == 'labctl: s3://bucket/lab: needs fsspec to be read: pip install "photonic-labctl[store]"\n'
