"""Calibrations on disk: which one a run refers to, and when it no longer stands."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from instruments.values import Answer
from labctl.analysis.estimates import Estimate
from labctl.bench import answers
from labctl.bench.calibration import concerns, folder_of, new_folder, newest, read, save, warnings
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION, Station, read_station
from labctl.commands.main import main
from labctl.engine.session import Acquisition, acquire
from labctl.runs.live.events import EventReader
from labctl.runs.read.run import open_run
from labctl.studies.alignment.findings import Finding, in_words
from protocols.image_readout import ImageReadout
from tests.observers import Follower

NOW = datetime(2026, 3, 2, 12, 0, tzinfo=UTC)
LONG_AGO = datetime(2020, 3, 2, tzinfo=UTC)
FAR_AHEAD = datetime(2999, 3, 2, tzinfo=UTC)
GOOD = Finding("delay", "trigger to light", None, Estimate(98e-9, 1e-12), "s")


def at(folder: Path, **changes: object) -> Station:
    """A station whose file is in `folder`."""
    file = folder / "bench.toml"
    file.touch()
    return SIMULATED_STATION.model_copy(update={"source": str(file), **changes})


def saved(station: Station, date: datetime, *findings: Finding) -> Path:
    folder = new_folder(station, date)
    folder.mkdir(parents=True)
    return save(folder, station, [one.values() for one in findings or (GOOD,)], {}, date)


def test_the_newest_of_the_same_bench_counts(tmp_path: Path) -> None:
    station = at(tmp_path)
    assert folder_of(station) == tmp_path / "calibrations"
    assert newest(station, NOW) is None
    saved(station, NOW - timedelta(days=1))
    path = saved(station, NOW)
    saved(station.twin(2), NOW + timedelta(days=1))
    saved(at(tmp_path, name="another"), NOW + timedelta(days=1))
    saved(station.cabled(projector=False), NOW + timedelta(days=2))
    found = newest(station, NOW + timedelta(days=3))
    assert found is not None
    assert found.path == path
    assert found.stored.findings[0]["value"] == 98e-9


def test_one_of_a_clock_that_was_ahead_is_left_out_and_told(tmp_path: Path) -> None:
    """It would hide all that are made until its date."""
    station = at(tmp_path)
    wrong = saved(station, FAR_AHEAD)
    (alone,) = warnings(None, station)
    assert alone.startswith(
        f"{wrong}: is dated 2999-03-02T00:00:00+00:00, which is yet to come, and is left out: check"
    )
    path = saved(station, NOW)
    found = newest(station, NOW)
    assert found is not None
    assert found.path == path
    assert alone in warnings(found.reference(), station)


def test_an_answer_of_a_clock_that_was_ahead_is_left_out_and_told(tmp_path: Path) -> None:
    station = at(tmp_path)
    agrees, differs = (Answer("which level", "high", found, found == "high") for found in ("high", "low"))
    wrong = answers.save(station, [agrees], FAR_AHEAD)
    (alone,) = answers.warnings(station)
    assert alone.startswith(f"{wrong}: is dated 2999-03-02")
    path = answers.save(station, [differs], NOW)
    assert [line.split(": ")[0] for line in answers.warnings(station)] == [str(wrong), str(path)]


def test_it_stands_until_it_is_old(tmp_path: Path) -> None:
    station = at(tmp_path)
    saved(station, NOW)
    found = newest(station, NOW)
    assert found is not None
    assert concerns(found, station, NOW + timedelta(days=6.9)) == []
    (told,) = concerns(found, station, NOW + timedelta(days=8))
    assert told == (
        f"{found.path}: it is 8 days old, more than calibration.valid = 7 days: measure again with 'labctl align'"
    )


def test_a_station_that_changed_is_named_key_by_key(tmp_path: Path) -> None:
    station = at(tmp_path)
    saved(station, NOW)
    changed = at(
        tmp_path,
        awg=station.awg.model_copy(update={"amplitude": 0.4, "timeout": 9.0}),
        limits=station.limits.model_copy(update={"rf_amplitude": 0.4}),
    )
    found = newest(changed, NOW)
    assert found is not None
    (told,) = concerns(found, changed, NOW)
    assert "awg.amplitude was 0.5, is 0.4" in told


def test_it_does_not_matter_how_the_station_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text('[laser]\ncommands = "tlg.toml"\n', encoding="utf-8")
    saved(read_station(Path("bench.toml")), NOW)
    named = read_station(tmp_path / "bench.toml")
    found = newest(named, NOW)
    assert found is not None
    assert concerns(found, named, NOW) == []


def test_one_that_fell_short_says_so(tmp_path: Path) -> None:
    station = at(tmp_path)
    saved(station, NOW, Finding("range", "range used", 1, Estimate(0.4, 0.01), "1", "more light or gain is needed"))
    found = newest(station, NOW)
    assert found is not None
    assert "not all of it was good" in concerns(found, station, NOW)[0]


def test_what_cannot_be_read_is_no_calibration(tmp_path: Path) -> None:
    station = at(tmp_path)
    path = saved(station, NOW)
    whole = path.read_text("utf-8")
    for damaged in (whole[:-20], whole.replace('"1.0"', '"2.0"'), "", "[]"):
        path.write_text(damaged, "utf-8")
        assert newest(station, NOW) is None


def test_a_run_refers_to_it(tmp_path: Path) -> None:
    station = at(tmp_path)
    path = saved(station, NOW)
    acquire(Acquisition(ImageReadout(images=2, classes=(0, 1), ports=(2,), window=4e-10), station, tmp_path / "run"))
    with open_run(tmp_path / "run") as run:
        reference = run.manifest["calibration"]
    found = newest(station, NOW)
    assert found is not None
    assert reference == {"path": str(path), "sha256": found.sha256, "date": "2026-03-02T12:00:00+00:00", "good": True}


def stopped_at_once(station: Station, directory: Path, warned: list[str]) -> Path:
    """A run that was stopped after its first record."""
    interruption = Interruption()

    def stop(_done: int, _total: int) -> None:
        interruption.requested = True

    asked = ImageReadout(images=2, classes=(0, 1), ports=(2,), window=4e-10)
    acquire(
        Acquisition(asked, station, directory),
        interruption=interruption,
        observer=Follower(stop, warning=warned.append),
    )
    return directory


def test_a_run_that_goes_on_is_warned_as_it_was_when_it_began(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = at(tmp_path, scope=SIMULATED_STATION.scope.model_copy(update={"bandwidth": 12.5e9}))
    path = saved(station, LONG_AGO)
    begun: list[str] = []
    run = stopped_at_once(station, tmp_path / "run", begun)
    (told,) = begun
    assert told.startswith(f"{path}: it is ")
    assert "days old, more than calibration.valid = 7 days" in told
    with pytest.raises(SystemExit) as ended:
        main(["resume", str(run), "--json"])
    out, err = capsys.readouterr()
    assert (ended.value.code, json.loads(out)["complete"]) == (0, True)
    assert err == f"labctl: {told}\n"
    heard = [event.fields["text"] for event in EventReader(run / "events.jsonl").read() if event.name == "warning"]
    assert heard == [told, told]


def test_a_run_refers_to_what_stood_when_it_was_begun(tmp_path: Path) -> None:
    station = at(tmp_path)
    path = saved(station, NOW)
    found = read(path)
    assert found is not None
    reference = found.reference()
    changed = at(tmp_path, awg=station.awg.model_copy(update={"address": "TCPIP0::192.0.2.1::INSTR"}))
    assert [line for line in warnings(reference, changed) if "awg.address was 'simulated', is 'TCPIP0::" in line]
    later = saved(station, NOW + timedelta(days=1))
    assert warnings(reference, station)[0].startswith(f"{later}: aligned after the run was begun")
    for one in (path, later):
        one.unlink()
    (told,) = warnings(reference, station)
    assert told.startswith(f"{tmp_path / 'calibrations'}: the calibration that the run refers to is not here any more")
    assert warnings(None, station) == []
    assert warnings("a stranger's", station) == []


def test_findings_are_told_with_their_stated_uncertainty() -> None:
    assert in_words(Estimate(98.0016e-9, 3e-12), "s") == "98.002 ± 0.012 ns"
    assert in_words(Estimate(0.7521, 0.0012), "1") == "75.21 ± 0.48 %"
    assert in_words(Estimate(-2e-6, 1e-6), "V") == "-2.0 ± 4.0 µV"
    assert in_words(Estimate(6.35, 0.01), "rad") == "6.350 ± 0.040 rad"
    assert GOOD.line() == "trigger to light 98.0000 ± 0.0040 ns: good"
