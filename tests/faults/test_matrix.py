"""Every fault, at every instrument, in every phase: the run goes on or ends as documented, and it ends dark."""

from pathlib import Path

import pytest

from tests.faults.document import DOCUMENT, document, documented
from tests.faults.matrix import MOMENTS, Case, Ended, carried_out, cases, outcome, undisturbed

WRITTEN = (Path(__file__).parents[2] / DOCUMENT).read_text(encoding="utf-8")
DOCUMENTED = documented(WRITTEN)


def _chosen() -> list[object]:
    """All cases. A fixed subset has every fault with every instrument, every fault in every phase and every instrument
    in every phase; the other ones belong to the whole matrix only."""
    whole = list(cases())
    faults = list(dict.fromkeys(case.name for case in whole))
    roles = list(MOMENTS)

    def is_short(case: Case) -> bool:
        phases = list(MOMENTS[case.role])
        turn = faults.index(case.name) + roles.index(case.role)
        return not case.common or case.phase == phases[turn % len(phases)]

    return [pytest.param(case, id=case.identifier, marks=() if is_short(case) else pytest.mark.full) for case in whole]


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], Ended]:
    ways = {case.options for case in cases()}
    return {options: undisturbed(tmp_path_factory.mktemp("undisturbed"), options) for options in ways}


@pytest.mark.parametrize("case", _chosen())
def test_fault(case: Case, expected: dict[tuple[str, ...], Ended], tmp_path: Path) -> None:
    ended = carried_out(case, tmp_path)
    assert outcome(case, ended, expected[case.options]) == DOCUMENTED[case.identifier]


def test_the_committed_document_is_whole() -> None:
    assert document(DOCUMENTED) == WRITTEN, "run python -m tests.faults.document"
