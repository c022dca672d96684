"""The short form of `make test-light`."""

import os
import sys
from pathlib import Path

import pytest

from tests.kills.light import STRIKES, strike

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="needs /proc"),
    pytest.mark.usefixtures("started_anew"),
]

SUPERVISED = {"supervisor"}
ITSELF = {"the run itself"}
BY = {
    "run killed": SUPERVISED,
    "its process group killed": SUPERVISED,
    "run stopped": SUPERVISED,
    "supervisor killed": ITSELF,
    "supervisor stopped": ITSELF,
    "both killed": SUPERVISED,
    "supervisor killed, then the run": SUPERVISED | ITSELF,
    "run and copy killed": SUPERVISED,
}
USUAL = ("its process group killed", "run stopped", "both killed", "run and copy killed")


@pytest.mark.parametrize(
    "name", [name if name in USUAL else pytest.param(name, marks=pytest.mark.full) for name in STRIKES]
)
def test_a_lit_laser_is_dark_whoever_is_killed_or_stopped(name: str, tmp_path: Path) -> None:
    (darkened,) = strike(tmp_path, trials=1, seed=os.getpid(), names=(name,)).values()
    assert not darkened.findings
    assert set(darkened.by) <= BY[name]
