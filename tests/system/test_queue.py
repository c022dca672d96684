"""A queue of real processes on the simulated bench: added to, reordered, killed with all it started, gone on with."""

import os
import signal
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.signals import Interruption
from labctl.errors import UsageError
from labctl.runs.format.layout import RunPaths
from labctl.runs.index import run_row
from labctl.runs.live.events import EventReader
from labctl.runs.notes import read_notes
from labctl.runs.queue import Queue, Wish
from labctl.studies.queue.work import OnFailure, Worked, work
from tests.command_line import answer, labctl
from tests.forked_processes import started_anew
from tests.system.waiting import until, until_stored

LABCTL = [sys.executable, "-m", "labctl"]
SMALL = ("run", "image-readout", "--set", "images=4", "--set", "ports=2", "--set", "window=0.4 ns")
PORTS = {"awg": 4000, "scope": 4001, "dmd": 4003, "patch_panel": 4004, "laser": 4002}
LONG = ("run", "image-readout", "--set", "images=400", "--set", "ports=2")


def queue(folder: Path, command: str, *words: object) -> tuple[int, dict[str, Any]]:
    """What `labctl queue` answers; the options of an item stand behind its own command."""
    return answer("queue", command, "--folder", folder, "--json", *words)[:2]


def put(folder: Path, words: tuple[str, ...], out: Path) -> None:
    """Add an item as `labctl queue add` does once its plan is made, which takes a process of its own."""
    Queue(folder).add((*words, "--out", str(out)), out, {}, "ada")


def states(folder: Path) -> list[tuple[int, str]]:
    return [(item["number"], item["state"]) for item in queue(folder, "list")[1]["items"]]


def complete(directory: Path) -> bool:
    return run_row(RunPaths(directory)).complete


def test_items_are_added_moved_and_removed(tmp_path: Path) -> None:
    assert queue(tmp_path, "list") == (0, {"items": []})
    assert not list(tmp_path.iterdir()), "looking makes nothing"
    for images in (40, 44, 48):
        assert queue(tmp_path, "add", "run", "image-readout", "--set", f"images={images}")[0] == 0
    status, found = queue(tmp_path, "move", 3, "--to", 1)
    assert (status, [item["number"] for item in found["items"]]) == (0, [3, 1, 2])
    assert found["items"][0]["words"][:3] == ["run", "--out", str(tmp_path / "queue-0003")]
    assert found["items"][0]["plan"]["shots"] == 54
    assert [item["number"] for item in queue(tmp_path, "remove", 1)[1]["items"]] == [3, 2]
    assert queue(tmp_path, "remove", 7)[1]["error"] == "item 7: there is none: see 'labctl queue list'"
    assert queue(tmp_path, "move", 2, "--to", 5)[1]["error"] == "place 5: 2 wait: choose 1 to 2"


def test_a_user_without_a_name_adds_items_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container whose user is a number."""
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os, "getuid", lambda: 54321)
    status, item = queue(tmp_path, "add", *SMALL)
    assert (status, item["added_by"]) == (0, "")


def test_what_is_listed_can_be_typed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Queue(tmp_path).add(SMALL, tmp_path / "run", {}, "ada")
    _, listed, _ = labctl(capsys, "queue", "list", "--folder", tmp_path)
    assert "labctl run image-readout --set images=4 --set ports=2 --set 'window=0.4 ns'" in listed
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "taken").touch()
    _, _, told = labctl(capsys, "queue", "start", "--folder", tmp_path)
    assert "1: labctl run image-readout --set images=4 --set ports=2 --set 'window=0.4 ns'" in told


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("check",), "a queue takes runs and sweeps"),
        (("run", "psychic"), "protocol 'psychic' is not installed"),
        (("run", "image-readout", "--set", "window=3"), "window"),
        (("sweep", "image-readout"), "--over is missing"),
        ((*SMALL, "--note"), "Option '--note' requires an argument"),
        ((*SMALL, "--out"), "Option '--out' requires an argument"),
        ((*SMALL, "--dry-run"), "--dry-run: nothing would be measured: leave it out"),
        ((*SMALL, "--help"), "--help: nothing would be measured"),
    ],
)
def test_what_is_wrong_is_said_when_it_is_added(tmp_path: Path, words: tuple[str, ...], told: str) -> None:
    status, found = queue(tmp_path, "add", *words)
    assert status == 2
    assert told in found["error"]
    assert states(tmp_path) == []
    assert not list(tmp_path.iterdir()), "nothing is measured"


def test_what_is_said_of_an_item_is_said_of_its_runs_whatever_it_reads_like(tmp_path: Path) -> None:
    said = ("--note", "see analysis.py", "--tag", "x.py", "--star", "--operator", "Ada")
    queue(tmp_path, "add", *SMALL, *said)
    queue(tmp_path, "add", "sweep", *SMALL[1:], "--over", "power=10 mW,30 mW", "--reference-every", "0", *said)
    assert queue(tmp_path, "start") == (0, {"done": 2, "failed": 0, "waiting": 0})
    runs = [tmp_path / "queue-0001", *sorted((tmp_path / "queue-0002").glob("*power*"))]
    assert len(runs) == 3
    for found in (read_notes(RunPaths(run)) for run in runs):
        assert ([one.text for one in found.notes], found.tags) == (["see analysis.py"], ("x.py",))
        assert (found.star, found.operator) == (True, "Ada")


def test_it_goes_on_where_it_was_when_the_machine_went_down(tmp_path: Path) -> None:
    put(tmp_path, SMALL, tmp_path / "queue-0001")
    put(tmp_path, LONG, tmp_path / "queue-0002")
    worker = subprocess.Popen([*LABCTL, "queue", "start", "--folder", str(tmp_path)], start_new_session=True)
    try:
        until_stored(worker, tmp_path / "queue-0002")
        assert states(tmp_path) == [(1, "done"), (2, "running")]
    finally:
        os.killpg(worker.pid, signal.SIGKILL)
        worker.wait()
    until(lambda: states(tmp_path) == [(1, "done"), (2, "waiting")])
    assert not complete(tmp_path / "queue-0002")
    status, found = queue(tmp_path, "start")
    assert (status, found) == (0, {"done": 1, "failed": 0, "waiting": 0})
    assert complete(tmp_path / "queue-0002")


def test_a_sweep_goes_on_with_the_scheduler_that_it_was_added_with(tmp_path: Path) -> None:
    sweep = ("sweep", *SMALL[1:], "--over", "power=10 mW,30 mW", "--reference-every", "0")
    assert answer(*sweep, "--out", tmp_path / "sweep", "--json")[0] == 0
    put(tmp_path, (*sweep, "--scheduler", "nobody"), tmp_path / "sweep")
    Queue(tmp_path).claim()  # as if it had begun that sweep and been killed
    assert queue(tmp_path, "start") == (1, {"done": 0, "failed": 1, "waiting": 0})
    [item] = queue(tmp_path, "list")[1]["items"]
    assert "nobody" in item["message"]


def test_an_item_that_outlives_whoever_carried_the_queue_out_runs_and_is_not_begun_again(tmp_path: Path) -> None:
    put(tmp_path, (*LONG[:3], "images=2000", *LONG[4:]), tmp_path / "run")
    worker = subprocess.Popen([*LABCTL, "queue", "start", "--folder", str(tmp_path)])
    until_stored(worker, tmp_path / "run")
    worker.kill()
    worker.wait()
    assert states(tmp_path) == [(1, "running")]
    status, found = queue(tmp_path, "start")
    assert status == 1
    assert "item 1 is still under way" in found["error"]
    assert answer("stop", tmp_path / "run", "--json")[0] == 0
    until(lambda: states(tmp_path) == [(1, "waiting")])


def test_an_item_whose_run_has_not_begun_when_the_queue_dies_is_not_begun_again(tmp_path: Path) -> None:
    put(tmp_path, (*LONG[:3], "images=2000", *LONG[4:]), tmp_path / "run")
    with started_anew():  # so that what it starts is the item alone
        worker = subprocess.Popen([*LABCTL, "queue", "start", "--folder", str(tmp_path)])
    children = Path(f"/proc/{worker.pid}/task/{worker.pid}/children")
    item = int(until(lambda: children.read_text().split())[0])
    worker.kill()
    worker.wait()
    try:
        assert states(tmp_path) == [(1, "running")]
        status, found = queue(tmp_path, "start")
        assert (status, "item 1 is still under way" in found["error"]) == (1, True)
        assert "nothing to stop" in queue(tmp_path, "stop")[1]["error"]
    finally:
        os.kill(item, signal.SIGKILL)
    until(lambda: states(tmp_path) == [(1, "waiting")])


def test_paths_count_from_where_the_item_was_added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there, elsewhere = tmp_path / "there", tmp_path / "elsewhere"
    there.mkdir()
    elsewhere.mkdir()
    (there / "bench.toml").write_text("[sim]\ntwin_seed = 4\n", encoding="utf-8")
    monkeypatch.chdir(there)
    words = (*SMALL, "--station", "bench.toml", "--out")
    assert queue(there, "add", *words, "run")[0] == 0
    for same in (there / "run", Path("..", "there", "run")):
        status, found = queue(there, "add", *words, same)
        assert (status, found["error"]) == (
            2,
            f"{there / 'run'}: is where item 1 of the queue goes: name another --out",
        )
    monkeypatch.chdir(elsewhere)
    assert queue(there, "start") == (0, {"done": 1, "failed": 0, "waiting": 0})
    assert complete(there / "run")
    assert not list(elsewhere.iterdir())


def test_an_item_whose_files_have_changed_since_it_was_added_is_not_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    protocol = 'protocol = "image-readout"\n[settings]\nimages = 4\nports = "2"\nwindow = "0.4 ns"\n'
    bench = "[sim]\ntwin_seed = 4\n"
    texts = {"run.toml": protocol, "sweep.toml": f'{protocol}[over]\npower = ["10 mW"]\n', "bench": bench}
    for name, text in texts.items():
        Path(name).write_text(text, encoding="utf-8")
    for words in (("run", "run.toml"), ("sweep", "sweep.toml"), (*SMALL, "--station", "bench")):
        assert queue(tmp_path, "add", *words)[0] == 0
    assert queue(tmp_path, "add", *SMALL, "--station=bench")[0] == 0
    Queue(tmp_path).add(("sweep", "sweep.toml", "--out", "begun"), Path("begun"), {"files": {"sweep.toml": "old"}}, "")
    assert answer("sweep", "sweep.toml", "--out", "begun", "--json")[0] == 0
    for name, text in texts.items():
        Path(name).write_text(text + "\n", encoding="utf-8")
    Queue(tmp_path).move(5, 1)
    Queue(tmp_path).claim()  # as if it had begun that sweep and been killed
    assert queue(tmp_path, "start", "--on-failure", "go-on")[1] == {"done": 1, "failed": 4, "waiting": 0}
    told = [item["message"] for item in queue(tmp_path, "list")[1]["items"]]
    changed = ("run.toml", "sweep.toml", "bench", "bench")
    assert told[1:] == [
        f"{tmp_path / one}: is not what it was when this was added here: add it again" for one in changed
    ]
    assert not list(tmp_path.glob("queue-0*"))


def test_a_file_whose_name_begins_with_a_dash_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    over = '[over]\npower = ["10 mW"]\n'
    settings = '[settings]\nimages = 4\nports = "2"\nwindow = "0.4 ns"\n'
    Path("-s.toml").write_text(f'protocol = "image-readout"\nreference_every = 0\n{settings}{over}', encoding="utf-8")
    assert queue(tmp_path, "add", "sweep", "--", "-s.toml")[0] == 0
    assert queue(tmp_path, "start") == (0, {"done": 1, "failed": 0, "waiting": 0})


def test_the_last_place_that_is_named_is_where_an_item_goes(tmp_path: Path) -> None:
    out = ("--out", tmp_path / "one", f"--out={tmp_path / 'other'}")
    assert queue(tmp_path, "add", *SMALL, *out)[1]["directory"] == str(tmp_path / "other")


def test_a_queue_of_an_earlier_version_goes_on(tmp_path: Path) -> None:
    put(tmp_path, SMALL, tmp_path / "run")
    with closing(sqlite3.connect(tmp_path / "queue.sqlite")) as database, database:
        database.execute("ALTER TABLE item DROP COLUMN cwd")
        database.execute("PRAGMA user_version = 1")
    assert states(tmp_path) == [(1, "waiting")]
    with closing(sqlite3.connect(tmp_path / "queue.sqlite")) as database, database:
        database.execute("UPDATE item SET state = 'lost'")
    status, found = queue(tmp_path, "list")
    assert status == 2
    assert "item 1 is damaged: 'lost' is not a valid State" in found["error"]


def test_what_would_fail_in_the_night_is_refused_now(tmp_path: Path) -> None:
    real = tmp_path / "real.toml"
    lines = [f'[{role}]\naddress = "TCPIP::192.0.2.1::{port}::SOCKET"\n' for role, port in PORTS.items()]
    real.write_text("".join(lines) + 'driver = "santec-tsl-570"\npower = "10 mW"\n', encoding="utf-8")
    for words, told in (
        ((*SMALL, "--station", real), "the laser is not armed"),
        ((*SMALL, "--out", real), f"--out = {real}: is not empty"),
        ((*SMALL, "--out", tmp_path), f"--out = {tmp_path}: is not empty"),
    ):
        status, found = queue(tmp_path / "runs", "add", *words)
        assert status == 2
        assert told in found["error"]
    put(tmp_path, SMALL, tmp_path / "new")
    with pytest.raises(UsageError, match="new: is where item 1 of the queue goes: name another --out"):
        put(tmp_path, SMALL, tmp_path / "new")


def test_a_queue_that_nobody_carries_out_is_not_stopped(tmp_path: Path) -> None:
    put(tmp_path, SMALL, tmp_path / "run")
    status, found = queue(tmp_path, "stop")
    assert (status, found["exit"]) == (2, 2)
    assert "nothing to stop" in found["error"]


def test_what_others_measured_is_not_taken_for_an_item_s_own(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    put(tmp_path, SMALL, taken)
    assert queue(tmp_path, "start") == (0, {"done": 1, "failed": 0, "waiting": 0})
    put(tmp_path, LONG, taken)
    assert queue(tmp_path, "start") == (1, {"done": 0, "failed": 1, "waiting": 0})
    [_, second] = queue(tmp_path, "list")[1]["items"]
    assert str(taken) in second["message"]


def test_an_item_without_a_place_gets_one_that_nobody_has_had(tmp_path: Path) -> None:
    def added() -> str:
        return Queue(tmp_path).add(SMALL, None, {}, "ada").words[2]

    assert [added(), added()] == [str(tmp_path / name) for name in ("queue-0001", "queue-0002")]
    (tmp_path / "queue-0001").mkdir()
    Queue(tmp_path).remove(1)
    (tmp_path / "queue-0003").mkdir()
    assert added() == str(tmp_path / "queue-0004"), "what was measured for an item that was removed stays"


def test_a_failure_ends_it_or_not_as_is_told(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    for out in (taken, tmp_path / "second", tmp_path / "third"):
        put(tmp_path, SMALL, out)
    taken.mkdir()
    (taken / "something").touch()
    status, found = queue(tmp_path, "start")
    assert (status, found) == (1, {"done": 0, "failed": 1, "waiting": 2})
    [first, *_] = queue(tmp_path, "list")[1]["items"]
    assert str(taken) in first["message"]
    queue(tmp_path, "remove", 1)
    put(tmp_path, SMALL, taken)
    queue(tmp_path, "move", 4, "--to", 1)
    assert queue(tmp_path, "start", "--on-failure", "go-on") == (1, {"done": 2, "failed": 1, "waiting": 0})


def test_an_item_that_is_interrupted_while_it_starts_waits_again(tmp_path: Path) -> None:
    put(tmp_path, (*LONG[:3], "images=2000", *LONG[4:]), tmp_path / "run")
    with started_anew():  # so that what it starts is the item alone
        worker = subprocess.Popen([*LABCTL, "queue", "start", "--folder", str(tmp_path)])
    children = Path(f"/proc/{worker.pid}/task/{worker.pid}/children")
    item = int(until(lambda: children.read_text().split())[0])
    until(lambda: b"images=2000" in Path(f"/proc/{item}/cmdline").read_bytes())  # no longer a copy of its parent
    os.kill(item, signal.SIGTERM)
    assert worker.wait() == 130
    assert states(tmp_path) == [(1, "waiting")]


def test_what_fails_while_item_and_queue_are_interrupted_waits_again(tmp_path: Path) -> None:
    """An item that hears Ctrl-C while it loads its libraries may end in any way."""
    interruption = Interruption()
    put(tmp_path, SMALL, tmp_path / "taken")
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "something").touch()

    def interrupt(_line: str) -> None:
        interruption.requested = True

    assert work(Queue(tmp_path), OnFailure.GO_ON, interruption, interrupt) == Worked(done=0, failed=0, waiting=1)


def test_stopping_now_takes_no_signal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On Windows a process can be sent none but one that kills it."""
    signalled = subprocess.Popen.send_signal

    def as_on_windows(process: subprocess.Popen[str], number: int) -> None:
        if number != signal.SIGTERM:
            raise ValueError(f"Unsupported signal: {number}")
        signalled(process, signal.SIGKILL)

    monkeypatch.setattr(subprocess.Popen, "send_signal", as_on_windows)
    put(tmp_path, (*LONG[:3], "images=2000", *LONG[4:]), tmp_path / "run")
    with ThreadPoolExecutor(1) as pool:
        worked = pool.submit(work, Queue(tmp_path), OnFailure.STOP, Interruption(), print)
        until(lambda: worked.done() or (tmp_path / "run" / "journal.jsonl").exists())
        Queue(tmp_path).ask(Wish.STOP_NOW)
        assert worked.result() == Worked(done=0, failed=0, waiting=1)
    assert [event.name for event in EventReader(tmp_path / "run" / "events.jsonl").read()][-1] == "stopped"
    assert not (tmp_path / "run" / "control").exists()


def test_an_item_goes_on_while_another_program_has_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, (*LONG[:3], "images=2000", *LONG[4:]), tmp_path / "run")
    journal = RunPaths(tmp_path / "run").journal
    with ThreadPoolExecutor(1) as pool:
        worked = pool.submit(work, Queue(tmp_path), OnFailure.STOP, Interruption(), print)
        until(lambda: worked.done() or journal.exists())
        with monkeypatch.context() as settings, closing(sqlite3.connect(tmp_path / "queue.sqlite")) as database:
            database.execute("BEGIN IMMEDIATE")
            settings.setattr("labctl.runs.queue.WAIT_S", 0.0)
            until(lambda: worked.done() or journal.read_bytes().count(b"\n") >= 10)
        Queue(tmp_path).ask(Wish.STOP_NOW)
        assert worked.result() == Worked(done=0, failed=0, waiting=1)


def test_while_it_runs_others_add_and_stop_and_nobody_starts_it_twice(tmp_path: Path) -> None:
    put(tmp_path, LONG, tmp_path / "queue-0001")
    worker = subprocess.Popen([*LABCTL, "queue", "start", "--folder", str(tmp_path)])
    until_stored(worker, tmp_path / "queue-0001")
    assert queue(tmp_path, "stop", "--now")[0] == 0
    assert worker.wait() == 130
    assert states(tmp_path) == [(1, "waiting")]
    assert not complete(tmp_path / "queue-0001"), "it ended with the shot"
    stored = RunPaths(tmp_path / "queue-0001").journal.read_bytes().count(b"\n")

    worker = subprocess.Popen([*LABCTL, "queue", "start", "--folder", str(tmp_path)])
    until_stored(worker, tmp_path / "queue-0001", shards=stored + 1)
    put(tmp_path, SMALL, tmp_path / "more")
    status, found = queue(tmp_path, "start")
    assert status == 1
    assert "another process carries this queue out" in found["error"]
    assert worker.wait() == 0
    assert states(tmp_path) == [(1, "done"), (2, "done")]
    assert complete(tmp_path / "queue-0001")
    assert complete(tmp_path / "more")
