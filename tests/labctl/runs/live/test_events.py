"""events.jsonl: what is told, how often, and what a reader makes of a damaged file."""

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from labctl.bench.signals import Interruption, StoppedBySignal
from labctl.bench.station import Station
from labctl.engine.session import Acquisition, Resumption, acquire, resume
from labctl.runs.live import events, logs
from labctl.runs.live.events import EventReader
from labctl.runs.live.logs import EventLog
from protocols.image_readout import ImageReadout
from tests.observers import Follower

PROTOCOL = ImageReadout(images=5, reference_every=5, window=0.8e-9)
RECORDS = 14


class Clock:
    def __init__(self) -> None:
        self.s = 0.0

    def __call__(self) -> float:
        return self.s


def fixed() -> datetime:
    return datetime(2026, 11, 21, 9, 15, 0, 125000, UTC)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "events.jsonl"


@pytest.fixture
def clock() -> Clock:
    return Clock()


def told(path: Path) -> list[tuple[str, dict[str, object]]]:
    return [(event.name, dict(event.fields)) for event in EventReader(path).read()]


def test_events_before_the_file_come_first_and_a_torn_line_is_ended(path: Path) -> None:
    path.write_bytes(b'{"time": "2026", "event": "to')
    with EventLog(now=fixed) as log:
        log.event("tuned", wavelength_nm=1550.0)
        log.keep_in(path)
        log.event("emission", on=True)
    lines = path.read_text().splitlines()
    assert json.loads(lines[1]) == {"time": "2026-11-21T09:15:00.125Z", "event": "tuned", "wavelength_nm": 1550.0}
    assert [name for name, _ in told(path)] == ["tuned", "emission"]


def test_progress_is_told_twice_a_second_with_rate_and_remaining_time(path: Path, clock: Clock) -> None:
    with EventLog(clock) as log:
        log.keep_in(path)
        for done in range(1, 101):
            clock.s += 0.01
            log.progress(done, 200, lambda: {"shot": 7})
        log.progress(200, 200, lambda: {})
    progress = [fields for _, fields in told(path)]
    assert [fields["done"] for fields in progress] == [1, 51, 200]
    assert progress[1] == {
        "done": 51,
        "total": 200,
        "rate_per_s": pytest.approx(100.0),
        "remaining_s": pytest.approx(1.49),
        "shot": 7,
    }


def test_a_long_run_tells_its_progress_seldom(path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "LARGE", 200)
    with EventLog(clock) as log:
        log.keep_in(path)
        for done in range(60):
            clock.s += 0.5
            log.progress(done, 1000, dict)
    *_, before, last = (fields["done"] for _, fields in told(path))
    assert last - before == 20  # type: ignore[operator]


def test_a_reader_follows_a_growing_file_and_leaves_out_what_is_no_event(path: Path) -> None:
    reader = EventReader(path)
    assert reader.read() == []
    path.write_bytes(b'{"time": "t", "event": "pau')
    assert reader.read() == []
    with path.open("ab") as file:
        file.write(b'sed"}\nnonsense\n[1]\n{"time": 1, "event": "x"}\n' + b"[" * 60000 + b"\n" + b"x" * 200_000 + b"\n")
        file.write(b'{"time": "t", "event": "going on"}\n')
    assert [event.name for event in reader.read()] == ["paused", "going on"]
    path.write_bytes(b'{"time": "t", "event": "run started"}\n')
    assert [event.name for event in reader.read()] == ["run started"]


def test_a_line_without_end_takes_no_memory(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(5_000_000)
    reader = EventReader(path)
    for _ in range(6):
        assert reader.read() == []
    assert len(reader._torn) <= events.LONGEST_LINE


def test_a_full_disk_ends_the_log_and_nothing_else(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with EventLog() as log:
        log.keep_in(Path("/dev/full"))
        log.event("emission", on=True)
        log.event("emission", on=False)
    assert caplog.text.count("it ends here") == 1


def test_a_run_tells_what_it_does(tmp_path: Path) -> None:
    acquire(Acquisition(PROTOCOL, Station(), tmp_path / "run"))
    found = told(tmp_path / "run" / "events.jsonl")
    names = [name for name, _ in found]
    assert names[-1] == "finished"
    assert names.count("pass started") == 2
    light = [fields["on"] for name, fields in found if name == "emission"]
    assert light == [True, False]
    assert names.index("safe state") > len(names) - 1 - names[::-1].index("progress")
    started = dict(found[names.index("run started")][1])
    assert (started["protocol"], started["records"], started["simulated"]) == ("image-readout", RECORDS, True)
    assert isinstance(started["process"], int)
    last = [fields for name, fields in found if name == "progress"][-1]
    assert (last["done"], last["total"]) == (RECORDS, RECORDS)
    assert last["kind"] == "reference", "the last shot with light; the dark frame behind it has no picture"
    first = next(fields for name, fields in found if name == "progress")
    assert first["image"]["rows"] == 28  # type: ignore[index]


def test_a_stopped_run_and_its_resumption_share_the_file(tmp_path: Path) -> None:
    interruption = Interruption()

    def stop(done: int, _total: int) -> None:
        interruption.requested = done == 3

    acquire(Acquisition(PROTOCOL, Station(), tmp_path / "run"), interruption=interruption, observer=Follower(stop))
    resume(Resumption(tmp_path / "run"))
    names = [name for name, _ in told(tmp_path / "run" / "events.jsonl")]
    assert names.index("stopped") < names.index("run resumed") < names.index("finished")


@pytest.mark.parametrize(("error", "event"), [(StoppedBySignal(), "stopped"), (OSError("no\nroom"), "failed")])
def test_what_ends_a_run_early_is_told(error: BaseException, event: str, tmp_path: Path) -> None:
    def fail(done: int, _total: int) -> None:
        if done == 3:
            raise error

    with pytest.raises(type(error)):
        acquire(Acquisition(PROTOCOL, Station(), tmp_path / "run"), observer=Follower(fail))
    found = told(tmp_path / "run" / "events.jsonl")
    assert [name for name, _ in found][-2:] == ["safe state", event]
    assert found[-1][1].get("error", "no room") == "no room"
