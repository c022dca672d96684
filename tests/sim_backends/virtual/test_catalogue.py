from collections.abc import Callable
from pathlib import Path

import pytest

from sim_backends.scpi.arguments import boolean
from sim_backends.scpi.commands import Action, Query, Setting
from sim_backends.virtual import catalogue
from tests.checkout import ROOT


@pytest.mark.parametrize(
    ("path", "document"), [(catalogue.DOCUMENT, catalogue.document), (catalogue.LACKING, catalogue.lacking)]
)
def test_the_committed_documents_are_up_to_date(path: Path, document: Callable[[], str]) -> None:
    assert (ROOT / path).read_text(encoding="utf-8") == document(), "run python -m sim_backends.virtual.catalogue"


def test_states() -> None:
    table = (
        Setting("OUTPut#[:STATe]", "output", boolean),
        Query("BUSY?", "busy"),
        Setting("LOCk", "lock", boolean, effect=False),
        Action("CLEAR", "clear"),
    )
    assert catalogue.states(table) == [
        ("BUSY", "query", catalogue.WORKS),
        ("CLEAR", "set", catalogue.WORKS),
        ("LOCk", "set and query", catalogue.WITHOUT_EFFECT),
        ("OUTPut#[:STATe]", "set and query", catalogue.WORKS),
    ]


def test_it_writes_where_it_is_told(tmp_path: Path) -> None:
    (tmp_path / catalogue.DOCUMENT.parent).mkdir(parents=True)
    assert catalogue.main(tmp_path) == 0
    assert (tmp_path / catalogue.DOCUMENT).read_text(encoding="utf-8") == catalogue.document()
    assert (tmp_path / catalogue.LACKING).read_text(encoding="utf-8") == catalogue.lacking()
