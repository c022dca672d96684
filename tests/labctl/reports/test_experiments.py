import base64
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labctl.reports import experiments
from labctl.reports.experiments import ExperimentEntry, ExperimentFigure, experiments_report
from labctl.reports.page import Result
from labctl.reports.pictures import ImageRow, image_rows_figure


class Page(HTMLParser):
    """Collects attributes and the words of table rows, and checks that elements are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: dict[str, list[str]] = {}
        self.rows: list[list[str]] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            self.attributes.setdefault(name, []).append(value or "")
        if tag not in ("meta", "img"):
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)
        if "td" in self.open or "th" in self.open:
            self.rows[-1][-1] += data


def entries() -> list[ExperimentEntry]:
    images = image_rows_figure([ImageRow("<original>", np.eye(28)[np.newaxis])])
    results = [
        Result("accuracy at 0.4 ns", "> 90 %", "≥ 90 %", "91.3 ± 2.9 %", reached=True, baseline="raw pixels 95.4 %"),
        Result("accuracy at 1 ns", "> 90 %", "≥ 94 %", "93.0 ± 2.0 %", reached=False),
        Result("numerical network", "comparable", "", "76.4 ± 4.4 %", None),
    ]
    return [
        ExperimentEntry(
            name="fig3",
            title="four <digits>",
            statement="The paper reports > 90 %.",
            results=results,
            figures=[ExperimentFigure("images", images, "Images & so on.")],
            seeds=[1, 2, 3],
            splits=10,
            seconds=41.4,
            settings={"protocol": {"ports": [2, 3]}, "station": "<script>alert(1)</script>"},
            notes=["Report both splits & say so."],
            cause="less light",
        ),
        ExperimentEntry("fig2", "traces", "A picture.", [Result("traces", "picture", "", "picture", None)]),
    ]


def write(directory: Path) -> Path:
    return experiments_report(directory / "report.html", entries=entries(), provenance={"versions": {"numpy": "2.4"}})


def test_the_report_stands_alone(tmp_path: Path) -> None:
    path = write(tmp_path / "new")
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    (source,) = page.attributes["src"]
    assert source.startswith("data:image/svg+xml;base64,")
    svg = base64.b64decode(source.split(",", 1)[1]).decode("utf-8")
    assert not re.search(r'(href|src)="(?!#|data:)', svg)
    assert all(link.startswith("#") for link in page.attributes["href"])
    assert {link[1:] for link in page.attributes["href"]} <= set(page.attributes["id"])
    assert "http" not in text.replace(source, "")
    assert {file.name for file in (tmp_path / "new" / "figures").iterdir()} == {"fig3-images.png", "fig3-images.svg"}


def test_the_first_table_holds_every_figure_that_must_be_reached(tmp_path: Path) -> None:
    page = Page(write(tmp_path).read_text(encoding="utf-8"))
    head, first, second, third = page.rows[:4]
    assert head[0] == "experiment"
    assert head[2:] == ["paper", "here (mean ± sd)", "must reach", "baseline", "seeds × splits", "verdict", "seconds"]  # noqa: RUF001
    numbers = ["accuracy at 0.4 ns", "> 90 %", "91.3 ± 2.9 %", "≥ 90 %", "raw pixels 95.4 %"]
    assert first == ["fig3", *numbers, "3 × 10", "pass", "41"]  # noqa: RUF001
    assert second == ["", "accuracy at 1 ns", "> 90 %", "93.0 ± 2.0 %", "≥ 94 %", "", "", "short", ""]
    assert third == ["fig2", "traces", "picture", "picture", "", "", "0", "", "0"]
    assert any(word.startswith("1 of 2 experiments") for word in page.words)


def test_a_section_says_what_was_done_and_why_it_falls_short(tmp_path: Path) -> None:
    page = Page(write(tmp_path).read_text(encoding="utf-8"))
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
    assert ["accuracy at 1 ns", "> 90 %", "≥ 94 %", "93.0 ± 2.0 %", "", "falls short"] in page.rows


def test_the_report_has_the_same_bytes_every_time(tmp_path: Path) -> None:
    assert write(tmp_path / "one").read_bytes() == write(tmp_path / "two").read_bytes()


def test_a_large_figure_goes_in_as_png(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiments, "LARGEST_SVG", 10)
    page = Page(write(tmp_path).read_text(encoding="utf-8"))
    assert page.attributes["src"][0].startswith("data:image/png;base64,")


def test_an_experiment_passes_when_nothing_falls_short() -> None:
    short, passed = entries()
    assert not short.passed
    assert passed.passed


def test_names_cannot_break_out_of_an_attribute(tmp_path: Path) -> None:
    evil: dict[str, Any] = {"title": '"><b>', "statement": "", "results": []}
    path = experiments_report(tmp_path / "report.html", entries=[ExperimentEntry('"x<', **evil)], provenance={})
    page = Page(path.read_text(encoding="utf-8"))
    assert '"x<' in page.attributes["id"]
