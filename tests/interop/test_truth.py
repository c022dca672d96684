"""The virtual Tektronix instruments against the manufacturer's descriptions: `python -m tests.truth` as a test."""

from typing import Any

import pytest

pytest.importorskip("tm_devices", reason="tm_devices is absent: `make interop` runs this")

from tests.truth.__main__ import judged
from tests.truth.comparison import compare
from tests.truth.descriptions import FAMILIES, described
from tests.truth.families import listed, path


def test_every_difference_is_documented(resources: Any) -> None:
    undocumented, stale = judged([compare(role, resources[role]["socket"]) for role in FAMILIES])
    assert undocumented == []
    assert stale == []


@pytest.mark.parametrize("role", FAMILIES)
def test_the_lists_of_headers_are_current(role: str) -> None:
    assert path(role).read_text(encoding="utf-8") == listed(role), "run python -m tests.truth.families"


def test_the_descriptions_are_read() -> None:
    scope, awg = (described(FAMILIES[role]) for role in ("scope", "awg"))
    assert scope["MEASUrement:IMMed:REFLevel:PERCent:HIGH"].default == 90
    assert scope["MEASUrement:IMMed:REFLevel:PERCent:HIGH"].limits == (0, 100)
    assert scope["CH#:DESKew"].limits == pytest.approx((-125e-9, 125e-9))
    assert scope["TRIGger:LVLSrcpreference"].default == "SRCIndependent"
    stop_after = scope["ACQuire:STOPAfter"].command
    assert stop_after is not None
    assert stop_after.words == ("RUNSTop", "SEQuence")
    assert scope["WFMOutpre:NR_Pt"].command is None
    assert awg["SOURce#:VOLTage:LEVel:IMMediate:HIGH"].default == pytest.approx(0.25)
    assert awg["AWGControl:RUN:IMMediate"].query is None
