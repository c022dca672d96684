"""Every fault, at every instrument, in every phase: the run goes on or ends as documented, and it ends dark."""

import gc
from pathlib import Path

import pytest

from sim_backends.faults.catalogue import FRAMES, HISLIP, VXI11
from tests.checkout import ROOT
from tests.faults.document import DOCUMENT, document, documented
from tests.faults.matrix import (
    BEHIND,
    CLIPPED,
    MOMENTS,
    NO_HARM,
    PATIENCE_S,
    TIMEOUT_S,
    Case,
    Ended,
    Way,
    carried_out,
    cases,
    outcome,
    undisturbed,
)

WRITTEN = (ROOT / DOCUMENT).read_text(encoding="utf-8")
DOCUMENTED = documented(WRITTEN)
WITHHELD = ("late", "no reply", "no end", "cleared")
"""What leaves everybody waiting for the end of a reply, even where that does no harm."""
FRAMED_ONCE = (*FRAMES, *HISLIP, *VXI11, "refused", "lost inside", "no end", "empty", "lost inside a block")


def _chosen() -> list[object]:
    """All cases. A fixed subset has every fault with every instrument, every fault in every phase, every instrument in
    every phase, and once each fault that only HiSLIP and VXI-11 know, or that befalls what stands behind the laser; the
    others belong to the whole matrix only.
    """
    whole = list(cases())
    faults = list(dict.fromkeys(case.name for case in whole))
    roles = list(MOMENTS)
    framed = {
        name: [case for case in whole if case.name == name and case.transport != "socket"] for name in FRAMED_ONCE
    }

    def is_short(case: Case) -> bool:
        if case.transport != "socket":
            ways = framed.get(case.name)
            return ways is not None and ways[faults.index(case.name) % len(ways)] is case
        phases = list(MOMENTS[case.role])
        turn = faults.index(case.name) + roles.index(case.role)
        if case.role in BEHIND and list(BEHIND)[faults.index(case.name) % len(BEHIND)] != case.role:
            return False
        return not case.common or case.phase == phases[turn % len(phases)]

    return [pytest.param(case, id=case.identifier, marks=() if is_short(case) else pytest.mark.full) for case in whole]


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[Way, Ended]:
    ways = {case.way: case for case in cases()}
    return {way: undisturbed(tmp_path_factory.mktemp("undisturbed"), case) for way, case in ways.items()}


@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")  # pyvisa-py's, of a session that it cannot open
@pytest.mark.parametrize("case", _chosen())
def test_fault(case: Case, expected: dict[Way, Ended], tmp_path: Path) -> None:
    # Where all is answered in the end, a busy machine is not a link that is lost.
    patient = DOCUMENTED[case.identifier] in (NO_HARM, CLIPPED) and case.name not in WITHHELD
    ended = carried_out(case, tmp_path, PATIENCE_S if patient else TIMEOUT_S)
    if case.transport != "socket":
        gc.collect()  # here, where those warnings are ignored
    assert outcome(case, ended, expected[case.way]) == DOCUMENTED[case.identifier]


@pytest.mark.parametrize("role", ["power_meter", "patch_panel"])
def test_no_light_goes_on_again_before_every_instrument_answers(role: str, tmp_path: Path) -> None:
    """Also those that the way into the safe state sends nothing to."""
    (dead,) = (case for case in cases() if (case.role, case.phase, case.name) == (role, "acquiring", "dead"))
    assert carried_out(dead, tmp_path).status == 1
    said = (tmp_path / "run" / "commands.log").read_text(encoding="utf-8")
    assert said.count("laser OUTPUT ON\n") == 1
    assert "all instruments answer" not in said


def test_the_committed_document_is_whole() -> None:
    assert document(DOCUMENTED) == WRITTEN, "run python -m tests.faults.document"
