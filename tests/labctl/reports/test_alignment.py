from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from labctl.reports.alignment import alignment_report
from labctl.reports.figures.images import images_figure
from labctl.runs.format.origin import Origin
from tests.labctl.reports.html import Page


def test_every_finding_stands_there_once_with_its_verdict_and_every_picture(tmp_path: Path) -> None:
    report = alignment_report(
        tmp_path,
        "<bench> & Co",
        datetime(2026, 11, 21, 20, 30, tzinfo=UTC),
        findings=[
            ("dark level", "11 ± 98 µV", "within the finest range", "good"),
            ("noise <b>", "0 V", "", "check"),
            ("depth", "", "", "not measured"),
        ],
        figures={"dark": images_figure(np.eye(28)[np.newaxis], ["one"])},
        origin=Origin.REAL,
    )
    page = Page(report)
    assert page.rows == [
        ["quantity", "found", "good is", "verdict"],
        ["dark level", "11 ± 98 µV", "within the finest range", "good"],
        ["noise <b>", "0 V", "", "check"],
        ["depth", "", "", "not measured"],
    ]
    assert "Alignment of <bench> & Co, 2026-11-21 20:30 UTC" in page.words
    assert "b" not in page.tags
    assert page.attributes["alt"] == ["Dark level and noise"]
    assert page.attributes["src"][0].startswith("data:image/svg+xml;base64,")
    assert page.tags.count("section") == 2
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"dark.png", "dark.svg", "dark.pdf"}
