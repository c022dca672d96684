"""Every setting that another client may change, at every moment: what is kept is right or marked."""

from pathlib import Path

import pytest

from tests.checkout import ROOT
from tests.knobs.document import DOCUMENT, document, documented
from tests.knobs.lies import LIES
from tests.knobs.settings import KNOBS
from tests.knobs.table import MODES, Case, Ended, carried_out, cases, outcome, undisturbed

WRITTEN = (ROOT / DOCUMENT).read_text(encoding="utf-8")
DOCUMENTED = documented(WRITTEN)


def _chosen() -> list[object]:
    """All cases. A fixed subset has every setting and every lie once, each at the next one of its moments."""
    whole = list(cases())
    own = [[case.identifier for case in whole if case.cause is cause] for cause in (*KNOBS, *LIES)]
    short = {identifiers[place % len(identifiers)] for place, identifiers in enumerate(own)}
    return [
        pytest.param(case, id=case.identifier, marks=() if case.identifier in short else pytest.mark.full)
        for case in whole
    ]


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    return {mode: undisturbed(mode, tmp_path_factory.mktemp("undisturbed")) for mode in MODES}


@pytest.mark.parametrize("case", _chosen())
def test_what_is_kept_is_right_or_marked(case: Case, expected: dict[str, Ended], tmp_path: Path) -> None:
    ended = carried_out(case, expected[case.mode], tmp_path)
    assert outcome(case, ended, expected) == DOCUMENTED[case.identifier]


def test_the_committed_document_is_whole() -> None:
    assert document(DOCUMENTED) == WRITTEN, "run python -m tests.knobs.document"
