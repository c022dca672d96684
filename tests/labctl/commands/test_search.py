"""`labctl train --search`: the best of several readouts, judged on what they are trained on."""

from pathlib import Path

from labctl.studies.readout_file import load_model
from tests.labctl.commands.conftest import AsJson, Typed

SEARCH = ("--search", "window=0.2 ns,0.4 ns", "--search", "C=0.001,1")


def test_every_combination_is_judged_and_the_best_is_saved(bench_run: Path, tmp_path: Path, as_json: AsJson) -> None:
    model = tmp_path / "best.h5"
    status, found = as_json("train", bench_run, *SEARCH, "--out", model)
    assert (status, found["model"]) == (0, str(model))
    rows = found["search"]
    assert [(row["window"], row["C"], row["features"]) for row in rows] == [
        ("0.2 ns", "0.001", 10),
        ("0.2 ns", "1", 10),
        ("0.4 ns", "0.001", 20),
        ("0.4 ns", "1", 20),
    ]
    assert found["best"]["accuracy"] == max(row["accuracy"] for row in rows)
    assert f"{found['window_s'] * 1e9:g} ns" == found["best"]["window"]
    assert load_model(model)[-1].C == found["inverse_penalty"] == float(found["best"]["C"])
    assert as_json("train", bench_run, *SEARCH, "--out", model, "--scheduler", "local") == (0, found)


def test_a_wrong_axis_is_refused(bench_run: Path, typed: Typed) -> None:
    assert typed("train", bench_run, "--search", "power=1,2")[0] == 2
    assert "--search power: is nothing to search over" in typed("train", bench_run, "--search", "power=1,2")[2]
    assert "--search C=0: must be above 0" in typed("train", bench_run, "--search", "C=0,1")[2]
    assert "--scheduler is for --search" in typed("train", bench_run, "--scheduler", "local")[2]
