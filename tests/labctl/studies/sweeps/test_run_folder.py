"""The runs of a sweep in a store, where another sweep may have put its own under the same names."""

from pathlib import Path

import pytest

import labctl
from labctl.bench.station import SIMULATED_STATION, Station
from labctl.commands.main import main
from labctl.engine.session import Acquisition, acquire
from labctl.errors import WrongPlace
from labctl.runs.format.layout import RunPaths
from labctl.runs.sweep import Sweep, read
from labctl.studies.sweeps.declaration import points
from labctl.studies.sweeps.evaluation import evaluate_sweep
from labctl.studies.sweeps.folder import begin
from labctl.studies.sweeps.run_folder import begun
from protocols.image_readout import ImageReadout

ASKED = Sweep(
    protocol="image-readout",
    settings={"images": 4, "window": "0.4 ns", "ports": "2"},
    over={"power": ("10 mW", "20 mW")},
    reference_every=0,
)
OTHER_TWIN = SIMULATED_STATION.twin(7)


def fill(store: Path, sweep: Sweep, station: Station = SIMULATED_STATION) -> None:
    for point in points(sweep, ImageReadout, station):
        acquire(Acquisition(point.protocol, point.station, store / point.name, coordinates=point.coordinates))


@pytest.fixture
def swept(tmp_path: Path) -> Path:
    """The folder of a sweep of which nothing is measured yet."""
    begin(tmp_path / "sweep", ASKED, ImageReadout, SIMULATED_STATION, store=tmp_path / "store")
    return tmp_path / "sweep"


def test_its_own_runs_have_begun(swept: Path, tmp_path: Path) -> None:
    assert begun(swept, read(swept)) == {}
    fill(tmp_path / "store", ASKED.model_copy(update={"settings": ASKED.settings | {"averages": 1}}))
    assert sorted(begun(swept, read(swept))) == sorted(path.name for path in (tmp_path / "store").iterdir())


@pytest.mark.parametrize(
    ("settings", "station", "differs"),
    [
        ({"images": 5}, SIMULATED_STATION, "protocol.settings.images is 5, not 4"),
        ({"averages": 2}, SIMULATED_STATION, "protocol.settings.averages is 2, not 1"),
        ({}, OTHER_TWIN, "station.sim.twin_seed is 7, not 1"),
    ],
    ids=["a setting", "a default", "another bench"],
)
def test_those_of_another_sweep_are_refused_by_all_that_look_at_its_runs(
    settings: dict[str, object],
    station: Station,
    differs: str,
    swept: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fill(tmp_path / "store", ASKED.model_copy(update={"settings": ASKED.settings | settings}), station)
    for look in (evaluate_sweep, labctl.open_runs, lambda folder: labctl.runs(folder=folder)):
        with pytest.raises(WrongPlace) as raised:
            look(swept)
        assert f"is of another sweep ({differs}): look at it with 'labctl runs {tmp_path}/store'" in str(raised.value)
    with pytest.raises(SystemExit) as ended:
        main(["verify", str(swept)])
    assert ended.value.code == 2
    assert differs in capsys.readouterr().err


def test_a_damaged_run_is_still_listed_and_verified(swept: Path, tmp_path: Path) -> None:
    fill(tmp_path / "store", ASKED)
    damaged = sorted((tmp_path / "store").iterdir())[0]
    RunPaths(damaged).manifest.write_text("{}", encoding="utf-8")
    assert [found.row.state for found in labctl.runs(folder=swept, sort="name")] == ["unreadable", "complete"]
