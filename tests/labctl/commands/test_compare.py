"""`labctl compare`, and `labctl runs` with its filters, on runs as they are measured."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from labctl.bench.drivers import sent_anew
from labctl.bench.station import write_addresses
from labctl.runs.read.differences import Difference, differences, settings_that_differ
from labctl.studies.comparison import compare
from sim_backends.bench import SimulatedBench
from tests.labctl.commands.conftest import AsJson, Typed


@pytest.fixture
def changed(bench_run: Path, tmp_path: Path) -> Path:
    """The same frames, said to be of another bench and another day; its data.h5 is not made yet."""
    directory = tmp_path / "changed"
    shutil.copytree(bench_run, directory)
    (directory / "data.h5").unlink()
    values: dict[str, Any] = json.loads((directory / "manifest.json").read_text())
    values["station"]["sim"]["twin_seed"] = 2
    values["versions"]["numpy"] = "9.9"
    values["started"] = "2026-11-30T00:00:00+00:00"
    (directory / "manifest.json").write_text(json.dumps(values))
    return directory


def test_two_runs_beside_each_other(bench_run: Path, changed: Path, as_json: AsJson) -> None:
    status, found = as_json("compare", bench_run, changed)
    assert status == 0
    assert found["runs"] == ["measured", "changed"]
    assert [(one["setting"], one["then"] == one["now"]) for one in found["differences"]] == [
        ("station.sim.twin_seed", False),
        ("versions.numpy", False),
    ]
    assert found["shots"][0] == found["shots"][1]
    assert found["shots"][0] == {"planned": 28, "complete": 28, "dark": 2, "image": 24, "reference": 2}
    assert found["same_image"]["correlation"] == {"port 2": pytest.approx(1), "port 3": pytest.approx(1)}
    assert found["accuracy"][0] == found["accuracy"][1]
    assert list(found["accuracy"][0])[-1] == "0.4"
    folder = bench_run / "figures" / "compared-with-changed"
    assert found["pictures"] == [str(folder / "traces.png"), str(folder / "accuracy.png")]
    assert compare(bench_run, changed).chances == (0.5, 0.5)
    drawn = (folder / "accuracy.svg").read_text("utf-8")
    assert ">60<" in drawn, "the axis begins below chance"
    assert ">40<" not in drawn
    for picture in found["pictures"]:
        with Image.open(picture) as image:
            assert image.width > 500


def test_a_run_beside_one_without_labels(
    bench_run: Path, tmp_path: Path, changed: Path, typed: Typed, monkeypatch: pytest.MonkeyPatch
) -> None:
    values: dict[str, Any] = json.loads((changed / "manifest.json").read_text())
    values["protocol"]["settings"]["dataset"] = "fashion-mnist"
    values["shape"]["passes"] = [[5, 6]]
    (changed / "manifest.json").write_text(json.dumps(values))
    monkeypatch.chdir(tmp_path)
    status, told, _ = typed("compare", bench_run, changed, "--out", "pictures")
    assert status == 0
    assert "protocol.settings.dataset" in told
    assert "the runs have no port in common" in told
    assert list((tmp_path / "pictures").iterdir()) == []


def test_what_earlier_commands_left_and_each_run_sends_anew_is_no_difference(tmp_path: Path, as_json: AsJson) -> None:
    station = tmp_path / "station.toml"
    with SimulatedBench() as bench:
        write_addresses(station, {name: found["socket"] for name, found in bench.resources.items()})
        for out, window in (("first", "0.4 ns"), ("second", "0.4 ns"), ("third", "0.8 ns")):
            words = ("--set", "images=4", "--set", "ports=2", "--set", f"window={window}")
            status, _ = as_json("run", "image-readout", *words, "--station", station, "--out", tmp_path / out)
            assert status == 0
    assert as_json("compare", tmp_path / "first", tmp_path / "second")[1]["differences"] == []
    found = as_json("compare", tmp_path / "first", tmp_path / "third")[1]["differences"]
    assert [one["setting"] for one in found] == ["protocol.settings.window", "shape.samples"]


def test_what_is_no_run_is_not_compared(bench_run: Path, tmp_path: Path, typed: Typed) -> None:
    status, out, told = typed("compare", bench_run, tmp_path)
    assert (status, out, told.count("\n")) == (2, "", 1)


def test_differences_are_named_and_rounding_is_none() -> None:
    then = {"a": {"b": 1, "c": 2.0, "list": [1, 2]}, "gone": "x", "seed": 10_000_001, "flag": True}
    now = {"a": {"b": 2, "c": 2.0 + 1e-9, "list": [1, 3]}, "new": None, "seed": 10_000_002, "flag": True, "more": 1.5}
    assert differences(then, now) == (
        Difference("a.b", 1, 2),
        Difference("a.list", [1, 2], [1, 3]),
        Difference("gone", "x", None),
        Difference("more", None, 1.5),
        Difference("seed", 10_000_001, 10_000_002),
    )
    assert differences(then, now, of="scope", ignored=("a.*", "[gms]*")) == ()
    assert settings_that_differ({"started": "a", "protocol": {"digest": "x"}}, {"started": "b"}, sent_anew) == ()


def test_a_wavelength_of_two_runs_differs_by_a_picometre() -> None:
    one, other = ({"protocol": {"start": start}} for start in (1550.0, 1550.001))
    assert settings_that_differ(one, other, sent_anew) == (Difference("protocol.start", 1550.0, 1550.001),)
    assert settings_that_differ({"a": 0.1 + 0.2}, {"a": 0.3}, sent_anew) == ()


def test_runs_are_filtered(bench_run: Path, changed: Path, as_json: AsJson, typed: Typed) -> None:
    first = changed.parent / "first"
    shutil.copytree(bench_run, first, ignore=shutil.ignore_patterns("figures"))
    manifest = json.loads((first / "manifest.json").read_text()) | {"started": "2026-11-21T00:00:00+00:00"}
    (first / "manifest.json").write_text(json.dumps(manifest))
    status, found = as_json("runs", changed.parent)
    assert (status, [Path(row["run"]).name for row in found["runs"]]) == (0, ["first", "changed"])
    assert {row["state"] for row in found["runs"]} == {"complete"}
    for options, names in (
        (("--limit", 1), ["changed"]),
        (("--sort", "name"), ["changed", "first"]),
        (("--since", "2026-11-29"), ["changed"]),
        (("--state", "incomplete"), []),
        (("--protocol", "image-readout", "--seed", 1), ["first", "changed"]),
    ):
        _, found = as_json("runs", changed.parent, *options)
        assert [Path(row["run"]).name for row in found["runs"]] == names
    assert "no run in it matches" in typed("runs", changed.parent, "--seed", 9)[1]
    for options, message in (
        (("--sort", "colour"), "colour: no run here has that: see `labctl runs --keys`"),
        (("--since", "yesterday"), "is not a date"),
        (("--state", "good"), "choose one of complete"),
        (("--where", "not"), "the end: comes where"),
        (("--where", "seed = 1 and", "--seed", 1), "the end: comes where"),
        (("--where", "((("), "the end: comes where"),
        (("--where", "seed = 1) or (seed = 2"), "): is not understood here"),
    ):
        status, _, told = typed("runs", changed.parent, *options)
        assert status == 2
        assert message in told
