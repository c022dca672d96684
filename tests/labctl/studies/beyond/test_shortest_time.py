import numpy as np
import pytest

from labctl.studies.beyond.shortest_time import ANALYSIS, conclude
from labctl.studies.paper import recognition
from labctl.studies.paper.recognition import Findings, Settings

WINDOWS = ("0.16", "0.2", "0.24")


def settings() -> Settings:
    curves = [{"key": key, "label": key, "run": "ports"} for key in ("many", "few")]
    windows = [f"{window} ns" for window in WINDOWS]
    return Settings.model_validate({"windows": windows, "curves": curves, "classes": ["a", "b"]})


def findings(*less: float) -> list[Findings]:
    """One bench for each of `less`: at 0.2 ns many ports are so much below raw pixels, and 3 points better later."""
    benches = []
    for place, below in enumerate(less):
        raw = np.array([0.94, 0.96]) + 0.01 * place
        many = [raw - 0.2, raw - below, raw - below + 0.03]
        scores = {
            "many": dict(zip(WINDOWS, many, strict=True)),
            "few": dict(zip(WINDOWS, [raw - 0.3] * 3, strict=True)),
        }
        benches.append(Findings(scores, {}, raw, {}, {}, {}))
    return benches


def test_the_shortest_time_is_where_raw_pixels_are_reached_by_mean_and_surely() -> None:
    concluded = conclude(findings(0.01, -0.02, 0.0), settings())
    here = concluded.here
    assert here["less_raw_pixels"]["many"]["0.16"]["mean"] == pytest.approx(-0.2)
    assert here["shortest_ns"] == {"many": 0.2, "few": None}
    assert here["surely_ns"] == {"many": None, "few": None}, "of three benches one differs by three points"
    assert conclude(findings(0.001, -0.001, 0.0), settings()).here["surely_ns"]["many"] == 0.24
    assert here["many"]["0.2"]["mean"] == pytest.approx(0.96 + 0.01 / 3)
    assert "many: raw pixels are reached at 0.2 ns, by the whole interval over benches at no time" in concluded.notes[0]
    assert [figure.stem for figure in concluded.figures] == ["accuracy", "less-raw-pixels"]


def test_one_bench_says_nothing_for_sure() -> None:
    here = conclude(findings(-0.02), settings()).here
    assert (here["shortest_ns"]["many"], here["surely_ns"]["many"]) == (0.2, None)


def test_a_bench_is_examined_as_in_the_papers_recognition() -> None:
    assert ANALYSIS.examine is recognition.examine
