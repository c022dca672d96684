import base64
from html.parser import HTMLParser
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.reports.figures import images_figure, save_figure
from labctl.reports.page import (
    Bullets,
    Folded,
    Paragraph,
    Part,
    Picture,
    Result,
    Results,
    Section,
    Table,
    mapping_section,
    write_report,
)


class Page(HTMLParser):
    """Collects elements, attributes and text of a page, and checks that elements are closed in order."""

    VOID = ("meta", "img", "br")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: dict[str, list[str]] = {}
        self.text: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            self.attributes.setdefault(name, []).append(value or "")
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


@pytest.fixture
def page(tmp_path: Path) -> Page:
    import numpy as np

    png, svg = save_figure(images_figure(np.eye(28)[np.newaxis], ["one"]), tmp_path / "figure")
    manifest = {
        "protocol": {"name": "image-readout", "ports": [2, 3]},
        "instruments": [{"kind": "awg", "identity": "<b>TEKTRONIX</b>"}],
    }
    sections = [
        Section("Results", [Results([Result("accuracy", "> 90 %", ">= 90 %", "91.2 ± 0.4 %", reached=True)])]),
        Section("Shorts", [Results([Result("a", "", "1", "0", reached=False), Result("b", "", "", "0", None)])]),
        Section("Figures", [Picture(svg, 'an "image"', "caption & more"), Picture(png, "again", "")]),
        Section("Words", [Paragraph("5 < 6"), Table(("name", "value"), [("x", "<script>alert(1)</script>")])]),
        mapping_section("Provenance", manifest),
    ]
    write_report(tmp_path / "report.html", title="A <run>", sections=sections)
    assert not (tmp_path / "report.html.partial").exists()
    return Page((tmp_path / "report.html").read_text(encoding="utf-8"))


def test_a_page_stands_alone(page: Page) -> None:
    assert page.tags.count("img") == 2
    assert all(source.startswith("data:image/") for source in page.attributes["src"])
    assert "href" not in page.attributes
    assert not {"script", "link", "iframe"} & set(page.tags)
    svg, png = (base64.b64decode(source.split(",", 1)[1]) for source in page.attributes["src"])
    assert b"<svg" in svg
    assert png.startswith(b"\x89PNG")


def test_everything_is_escaped(page: Page) -> None:
    for text in ("A <run>", "5 < 6", "<script>alert(1)</script>", "<b>TEKTRONIX</b>", "caption & more"):
        assert text in page.text
    assert 'an "image"' in page.attributes["alt"]


def test_the_table_of_results_says_what_falls_short(page: Page) -> None:
    words = [text for text in page.text if text.strip()]
    for word in ("paper", "required", "here", "verdict", "91.2 ± 0.4 %", "reached", "falls short"):
        assert word in words


def test_provenance_is_flattened(page: Page) -> None:
    for name in ("protocol.name", "protocol.ports", "instruments.0.identity", "2, 3"):
        assert name in page.text


@given(st.text(st.characters(exclude_categories=("Cs", "Cc"))), st.text(st.characters(exclude_categories=("Cs", "Cc"))))
def test_any_text_survives(tmp_path_factory: pytest.TempPathFactory, title: str, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any.html"
    write_report(path, title=title, sections=[Section(text, [Paragraph(text), Table((text,), [(text, title)])])])
    page = Page(path.read_text(encoding="utf-8"))
    assert "".join(page.text).count(text) >= 4


def test_lists_and_folded_parts_are_escaped_and_links_lead_to_sections(tmp_path: Path) -> None:
    parts: list[Part] = [Bullets(["a < b", "c"]), Folded("more & more", [Paragraph("inside")])]
    write_report(tmp_path / "report.html", title="parts", sections=[Section("one", parts, anchor='o"ne')])
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert page.attributes["id"] == ['o"ne']
    for text in ("a < b", "more & more", "inside"):
        assert text in page.text
    assert page.tags.count("li") == 2
    assert page.tags.count("details") == 1


def test_a_baseline_gets_a_column_where_there_is_one() -> None:
    without = Results([Result("a", "1", "2", "3", reached=True)]).html()
    with_one = Results([Result("a", "1", "2", "3", reached=True, baseline="95 <")]).html()
    assert "baseline" not in without
    assert "<td>95 &lt;</td>" in with_one
