"""Which drivers are installed, and how one that is not, or does not fit, is refused."""

from pathlib import Path

import pytest

from labctl.bench.drivers import driver, installed
from labctl.bench.station import USUAL
from labctl.errors import StationError


def plug_in(folder: Path, points: str, *, module: str = "") -> None:
    """A package with entry points, as pip would leave it in `folder`."""
    about = folder / "misfit_lab-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: misfit-lab\nVersion: 1.0\n", "utf-8")
    (about / "entry_points.txt").write_text(f"[labctl.instruments]\n{points}\n", "utf-8")
    (folder / "misfit_lab.py").write_text(module, "utf-8")


def test_every_instrument_has_its_usual_driver_and_some_are_set_by_hand() -> None:
    found = installed()
    assert {role: found[name].role for role, name in USUAL.items()} == {role: role for role in USUAL}
    assert {name for name, one in found.items() if one.by_hand} == {"manual-laser", "manual-patch-panel"}
    assert set(installed("laser")) == {"alnair-tlg-220", "manual-laser", "santec-tsl-570"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "nothing",
            r"laser\.driver = 'nothing' is not installed: choose one of alnair-tlg-220, manual-laser, santec-tsl-570$",
        ),
        (
            "vialux-alp",
            r"laser\.driver = 'vialux-alp' is a driver of dmd: choose one of alnair-tlg-220, manual-laser, san",
        ),
        ("a\nb" * 100, r"laser\.driver = 'a\\nba\\n\S{3,60} is not installed"),
    ],
)
def test_a_driver_that_is_not_for_the_instrument_is_refused_in_one_line(name: str, message: str) -> None:
    with pytest.raises(StationError, match=message) as refused:
        driver("laser", name)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ("their-laser = misfit_lab:laser", r"misfit_lab:laser is no instruments\.driver\.Driver"),
        ("their-laser = misfit_lab:gone", "module 'misfit_lab' has no attribute 'gone'"),
    ],
)
def test_a_package_that_does_not_fit_is_named_and_spoils_nothing_else(
    point: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plug_in(tmp_path, point, module="def laser(section, opening): ...\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(StationError, match=rf"laser\.driver = 'their-laser' does not load \(.*{message}\): choose one"):
        driver("laser", "their-laser")
    assert set(installed("laser")) == {"alnair-tlg-220", "manual-laser", "santec-tsl-570"}
