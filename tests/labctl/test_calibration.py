"""Calibrations on disk: which one a run refers to, and when it no longer stands."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

from labctl.acquisition import Acquisition, acquire
from labctl.analysis.estimates import Estimate
from labctl.calibration import concerns, folder_of, new_folder, newest, save
from labctl.findings import Finding, in_words
from labctl.runs import open_run
from labctl.station import SIMULATED_STATION, Station
from protocols.image_readout import ImageReadout

NOW = datetime(2026, 3, 2, 12, 0, tzinfo=UTC)
GOOD = Finding("delay", "trigger to light", None, Estimate(98e-9, 1e-12), "s")


def at(folder: Path, **changes: object) -> Station:
    """A station whose file is in `folder`."""
    file = folder / "bench.toml"
    file.touch()
    return SIMULATED_STATION.model_copy(update={"source": str(file), **changes})


def saved(station: Station, date: datetime, *findings: Finding) -> Path:
    folder = new_folder(station, date)
    folder.mkdir(parents=True)
    return save(folder, station, findings or (GOOD,), {}, date)


def test_the_newest_of_the_same_bench_counts(tmp_path: Path) -> None:
    station = at(tmp_path)
    assert folder_of(station) == tmp_path / "calibrations"
    assert newest(station) is None
    saved(station, NOW - timedelta(days=1))
    path = saved(station, NOW)
    saved(station.twin(2), NOW + timedelta(days=1))
    saved(at(tmp_path, name="another"), NOW + timedelta(days=1))
    saved(station.cabled(projector=False), NOW + timedelta(days=2))
    found = newest(station)
    assert found is not None
    assert found.path == path
    assert found.stored.findings[0]["value"] == 98e-9


def test_it_stands_until_it_is_old(tmp_path: Path) -> None:
    station = at(tmp_path)
    saved(station, NOW)
    found = newest(station)
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
    found = newest(changed)
    assert found is not None
    (told,) = concerns(found, changed, NOW)
    assert "awg.amplitude was 0.5, is 0.4" in told


def test_one_that_fell_short_says_so(tmp_path: Path) -> None:
    station = at(tmp_path)
    saved(station, NOW, Finding("range", "range used", 1, Estimate(0.4, 0.01), "1", "more light or gain is needed"))
    found = newest(station)
    assert found is not None
    assert "not all of it was good" in concerns(found, station, NOW)[0]


def test_what_cannot_be_read_is_no_calibration(tmp_path: Path) -> None:
    station = at(tmp_path)
    path = saved(station, NOW)
    whole = path.read_text("utf-8")
    for damaged in (whole[:-20], whole.replace('"1.0"', '"2.0"'), "", "[]"):
        path.write_text(damaged, "utf-8")
        assert newest(station) is None


def test_a_run_refers_to_it(tmp_path: Path) -> None:
    station = at(tmp_path)
    path = saved(station, NOW)
    acquire(Acquisition(ImageReadout(images=2, classes=(0, 1), ports=(2,), window=4e-10), station, tmp_path / "run"))
    with open_run(tmp_path / "run") as run:
        reference = run.manifest["calibration"]
    found = newest(station)
    assert found is not None
    assert reference == {"path": str(path), "sha256": found.sha256, "date": "2026-03-02T12:00:00+00:00", "good": True}


def test_findings_are_told_with_their_stated_uncertainty() -> None:
    assert in_words(Estimate(98.0016e-9, 3e-12), "s") == "98.002 ± 0.012 ns"
    assert in_words(Estimate(0.7521, 0.0012), "1") == "75.21 ± 0.48 %"
    assert in_words(Estimate(-2e-6, 1e-6), "V") == "-2.0 ± 4.0 µV"
    assert in_words(Estimate(6.35, 0.01), "rad") == "6.350 ± 0.040 rad"
    assert GOOD.line() == "trigger to light 98.0000 ± 0.0040 ns: good"
