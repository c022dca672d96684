import base64
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.analysis.intervals import Verdict
from labctl.reports.experiments import ExperimentEntry, ExperimentFigure, experiments_report
from labctl.reports.figures.images import ImageRow, image_rows_figure
from labctl.reports.page import Averaged, CarryOut, Result
from labctl.runs.format.origin import Origin
from labctl.studies.processes import side_by_side
from labctl.studies.tasks import one_by_one
from tests.labctl.reports.html import Page

REPEATS = "3 × 10"  # noqa: RUF001
TEXT = st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1)


def entries() -> list[ExperimentEntry]:
    images = image_rows_figure([ImageRow("<original>", np.eye(28)[np.newaxis])])
    results = [
        Result(
            "accuracy at 0.4 ns",
            "> 90 %",
            "≥ 90 %",
            "91.3 ± 2.9 %",
            Verdict.REACHED,
            "raw pixels 95.4 %",
            Averaged("≥ 95 %", "95.1 %", Verdict.OPEN),
            REPEATS,
        ),
        Result("accuracy at 1 ns", "> 90 %", "≥ 94 %", "93.0 ± 2.0 %", Verdict.NOT_REACHED),
        Result("numerical network", "comparable", "", "76.4 ± 4.4 %", None),
    ]
    return [
        ExperimentEntry(
            name="fig3",
            title="four <digits>",
            statement="The paper reports > 90 %.",
            results=results,
            origin=Origin.SIMULATED,
            figures=[ExperimentFigure("images", images, "Images & so on.")],
            seeds=[1, 2, 3],
            splits=10,
            seconds=41.4,
            settings={"protocol": {"ports": [2, 3]}, "station": "<script>alert(1)</script>"},
            notes=["Report both splits & say so."],
            cause="less light",
        ),
        ExperimentEntry(
            "fig2", "traces", "A picture.", [Result("traces", "picture", "", "picture", None)], Origin.REAL
        ),
    ]


def write(directory: Path) -> Path:
    return experiments_report(
        directory / "report.html",
        entries=entries(),
        provenance={"versions": {"numpy": "2.4"}},
        title="All",
        carried_out=one_by_one,
    )


@pytest.mark.parametrize("seeds", [(1, 2, 3), (1,)])
def test_intervals_are_spoken_of_where_there_are_some(tmp_path: Path, seeds: tuple[int, ...]) -> None:
    found = [replace(entry, seeds=seeds, figures=()) for entry in entries()]
    path = experiments_report(
        tmp_path / "report.html", entries=found, provenance={}, title="All", carried_out=one_by_one
    )
    text = path.read_text("utf-8")
    assert ("in brackets" in text) is (len(seeds) > 1)
    assert ("Figures of one seed have no interval" in text) is (len(seeds) == 1)


def test_the_report_stands_alone(tmp_path: Path) -> None:
    path = write(tmp_path / "new")
    text = path.read_text(encoding="utf-8")
    page = Page(path)
    assert not {"script", "link", "iframe"} & set(page.tags)
    (source,) = page.attributes["src"]
    assert source.startswith("data:image/svg+xml;base64,")
    svg = base64.b64decode(source.split(",", 1)[1]).decode("utf-8")
    assert not re.search(r'(href|src)="(?!#|data:)', svg)
    assert all(link.startswith("#") for link in page.attributes["href"])
    assert {link[1:] for link in page.attributes["href"]} <= set(page.attributes["id"])
    assert "http" not in text.replace(source, "")
    files = {file.name for file in (tmp_path / "new" / "figures").iterdir()}
    assert files == {"fig3-images.png", "fig3-images.svg", "fig3-images.pdf"}
    assert "simulated bench" in svg


def test_the_first_table_holds_every_figure_of_single_triggers_and_their_mean(tmp_path: Path) -> None:
    page = Page(write(tmp_path))
    head, first, second, third, fourth = page.rows[:5]
    columns = ["single triggers", "must reach", "verdict", "mean of several", "must reach", "verdict"]
    assert head == ["experiment", "", "paper", *columns, "baseline", "seeds × splits", "seconds"]  # noqa: RUF001
    single, several = ["91.3 ± 2.9 %", "≥ 90 %", "reached"], ["95.1 %", "≥ 95 %", "open"]
    assert first == [
        "fig3", "accuracy at 0.4 ns", "> 90 %", *single, *several, "raw pixels 95.4 %", REPEATS, "41"
    ]  # fmt: skip
    assert second == ["", "accuracy at 1 ns", "> 90 %", "93.0 ± 2.0 %", "≥ 94 %", "not reached", *[""] * 6]
    assert third == ["", "numerical network", "comparable", "76.4 ± 4.4 %", *[""] * 8]
    assert fourth == ["fig2", "traces", "picture", "picture", *[""] * 7, "0"]
    assert any(word.startswith("In 1 of 2 experiments") for word in page.words)


def test_a_section_says_what_was_done_and_why_it_falls_short(tmp_path: Path) -> None:
    page = Page(write(tmp_path))
    for words in (
        "fig3: four <digits>",
        "Why it falls short: less light",
        "Report both splits & say so.",
        "Images & so on.",
        "Seeds 1, 2, 3; 10 random splits for each; 41 s.",
        "protocol.ports",
        "<script>alert(1)</script>",
        "versions.numpy",
    ):
        assert words in page.words
    assert ["accuracy at 1 ns", "> 90 %", "≥ 94 %", "93.0 ± 2.0 %", "not reached", "", "", "", ""] in page.rows


def test_the_report_has_the_same_bytes_every_time(tmp_path: Path) -> None:
    assert write(tmp_path / "one").read_bytes() == write(tmp_path / "two").read_bytes()


def test_an_experiment_passes_when_nothing_falls_short() -> None:
    short, passed = entries()
    assert not short.passed
    assert passed.passed


def test_baseline_and_mean_have_columns_where_there_are_any(tmp_path: Path) -> None:
    rows = Page(write(tmp_path)).rows
    several = ["required", "mean of several", "verdict"]
    assert ["", "paper", "required", "single triggers", "verdict", *several, "baseline"] in rows
    single = ["≥ 90 %", "91.3 ± 2.9 %", "reached"]
    assert ["accuracy at 0.4 ns", "> 90 %", *single, "≥ 95 %", "95.1 %", "open", "raw pixels 95.4 %"] in rows
    assert ["", "paper", "required", "here", "verdict"] in rows
    assert ["traces", "picture", "", "picture", ""] in rows


def test_names_cannot_break_out_of_an_attribute(tmp_path: Path) -> None:
    drawn = ExperimentFigure("images", image_rows_figure([ImageRow("a", np.eye(28)[np.newaxis])]), "")
    entry = ExperimentEntry('"x<', '"><b>', "", [Result("a", "", "", "", None)], Origin.REAL, figures=[drawn])
    page = Page(
        experiments_report(
            tmp_path / "report.html", entries=[entry], provenance={}, title="All", carried_out=one_by_one
        )
    )
    assert page.attributes["id"] == ['"x<']
    assert page.attributes["href"] == ['#"x<']
    assert page.attributes["alt"] == ['"><b>: images']


@given(TEXT, TEXT)
def test_any_text_survives(tmp_path_factory: pytest.TempPathFactory, one: str, other: str) -> None:
    result = Result(one, other, one, other, Verdict.REACHED, one)
    entry = ExperimentEntry(
        one, other, one, [result], Origin.REAL, settings={one: {other: one}}, notes=[other], cause=one
    )
    path = tmp_path_factory.getbasetemp() / "any.html"
    page = Page(experiments_report(path, entries=[entry], provenance={one: [other]}, title=one, carried_out=one_by_one))
    name, *cells = page.rows[1]
    assert [name, *cells[:6]] == [one, one, other, other, one, "reached", one]
    assert [one, other, one, other, "reached", one] in page.rows
    assert [f"{one}.{other}", one] in page.rows
    assert [one, other] in page.rows
    text = "".join(page.words)
    for words in (f"{one}: {other}", f"Why it falls short: {one}", other):
        assert words in text
    assert page.tags.count("h1") == page.tags.count("li") == 1
    assert page.tags.count("details") == 2


def test_figures_are_the_same_whoever_draws_them(tmp_path: Path) -> None:
    def written(carried_out: CarryOut[tuple[str, str]], folder: Path) -> dict[str, bytes]:
        figures = [
            ExperimentFigure(name, image_rows_figure([ImageRow(name, np.eye(28)[np.newaxis])]), "")
            for name in ("one", "other")
        ]
        entry = ExperimentEntry("fig6", "images", "", [], Origin.SIMULATED, figures=figures)
        experiments_report(folder / "report.html", entries=[entry], provenance={}, title="All", carried_out=carried_out)
        return {path.name: path.read_bytes() for path in folder.rglob("*.*")}

    here, side = written(one_by_one, tmp_path / "here"), written(side_by_side, tmp_path / "side")
    assert here == side
    assert len(here) == 7
