from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from instruments.values import Drive, Frames
from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.runs.format.columns import shot_table
from labctl.runs.format.shape import RunShape
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter
from labctl.studies.paper.imaging import ANALYSIS, Settings, conclude, examine
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.base import Shot
from protocols.dynamic_scene import DynamicScene
from protocols.image_readout import ImageReadout

pytest.importorskip("torch")

WriteRun = Callable[..., Path]
PORTS, WINDOW, INTERVAL_S = (2, 3), 25, 40e-12
PERIOD, RECORD = 2500, 250_000
STILL = ImageReadout(images=60, ports=PORTS)
MASKS = np.random.default_rng(1).standard_normal((784, 2 * 2 * WINDOW)) / 28
"""What one pixel does to a window, for two ports and two wavelengths."""


def codes_of(pixels: np.ndarray, columns: slice) -> np.ndarray:
    noise = np.random.default_rng(2).normal(0, 5, (len(pixels), 2, WINDOW))
    return 1000 * (pixels.reshape(len(pixels), -1) @ MASKS[:, columns]).reshape(-1, 2, WINDOW) + noise


def pixels_of(shots: list[Shot], name: str = "dataset_index") -> np.ndarray:
    inputs = images_for(STILL)
    places = {int(index): place for place, index in enumerate(inputs.indices)}
    return np.stack([inputs.images[places.get(getattr(shot, name), 0)] for shot in shots])


def curve(**changes: object) -> dict[str, object]:
    return {
        "key": "digits",
        "label": "digits",
        "run": "still",
        "windows": ["1 ns"],
        "network_windows": ["1 ns"],
        "paper": 0.219,
    } | changes


def twin_runs(folder: Path, write_run: WriteRun, moving: DynamicScene | None = None) -> TwinRuns:
    """Digits through random masks; scenes whose second image is there from half-way through the switch on."""
    moving = moving or DynamicScene(images=60, scenes=1, ports=PORTS)
    shots, scenes = list(STILL.shots(images_for(STILL))), list(moving.shots(images_for(STILL)))
    records = np.zeros((len(scenes), 2, RECORD), np.int16)
    for name, first, last in (("dataset_index", 0, 56), ("next_dataset_index", 56, 100)):
        for start in range(first * PERIOD, last * PERIOD, PERIOD):
            records[:, :, start : start + WINDOW] = codes_of(pixels_of(scenes, name), slice(0, 2 * WINDOW))
    runs = {
        "still": write_run(
            folder / "still", shots, codes_of(pixels_of(shots), slice(0, 2 * WINDOW)), PORTS, INTERVAL_S
        ),
        "scenes": write_run(folder / "scenes", scenes, records, PORTS, INTERVAL_S),
    }
    return TwinRuns(runs, {"still": STILL, "scenes": moving}, 1, 2)


FILM = {"run": "scenes", "still": "still", "window": "1 ns", "times": ["1 us", "5.2 us", "5.6 us", "9 us"]}


def test_images_come_back_and_the_switch_is_filmed(tmp_path: Path, write_run: WriteRun) -> None:
    settings = Settings.model_validate({"curves": [curve()], "film": FILM})
    found = examine(twin_runs(tmp_path, write_run), settings)
    digits = found.curves["digits"]
    assert digits.originals.shape == digits.examples["network"].shape == digits.examples["best"].shape
    assert digits.originals.shape[1:] == (28, 28)
    concluded = conclude([found, found], settings)
    here, mean_image = concluded.here["digits"], concluded.baseline["digits"]["mean_image"]["mean"]
    assert set(here) == {"network", "best", "linear"}
    assert here["best"]["1.0"]["mean"] < mean_image
    assert here["linear"]["1.0"]["mean"] < mean_image
    assert len(here["network"]["1.0"]["by_bench"]) == 2
    assert found.film is not None
    assert found.film.time_s[found.film.shown] == pytest.approx([1e-6, 5.2e-6, 5.6e-6, 9e-6])
    film = concluded.here["film"]
    assert film["scenes"] == 2
    assert film["mirrors_move_us"] == pytest.approx([5.1, 6.1])
    assert film["best"]["switch_us"]["mean"] == pytest.approx(5.6)
    assert film["best"]["scenes_switched"] == 2
    assert [figure.stem for figure in concluded.figures] == ["images-still", "errors", "film"]


def test_networks_are_trained_on_the_first_benches(tmp_path: Path, write_run: WriteRun) -> None:
    settings = Settings.model_validate({"curves": [curve()], "film": FILM, "network_benches": 1})
    given = twin_runs(tmp_path, write_run)
    found = [examine(replace(given, place=place), settings) for place in (0, 1)]
    here = conclude(found, settings).here
    benches = {name: len(windows["1.0"]["by_bench"]) for name, windows in here["digits"].items()}
    assert benches == {"network": 1, "best": 2, "linear": 2}
    assert {name: here["film"][name]["scenes"] for name in ("network", "best")} == {"network": 1, "best": 2}


def test_what_a_film_cannot_be_made_of(tmp_path: Path, write_run: WriteRun) -> None:
    given = twin_runs(tmp_path, write_run)
    settings = Settings.model_validate({"curves": [curve()], "film": FILM})
    swapped = TwinRuns(given.runs, {"still": STILL, "scenes": STILL}, 1, 2)
    with pytest.raises(AnalysisError, match="image-readout switches no images"):
        examine(swapped, settings)
    assert settings.film is not None
    short = settings.film.model_copy(update={"arrives": 9e-6})
    with pytest.raises(AnalysisError, match="no window lies wholly before or behind the switch"):
        examine(given, settings.model_copy(update={"film": short}))


def test_a_film_on_other_ports_is_refused(tmp_path: Path, write_run: WriteRun) -> None:
    given = twin_runs(tmp_path, write_run)
    scenes = list(given.protocols["scenes"].shots(images_for(STILL)))
    other = write_run(tmp_path / "other", scenes, np.zeros((1, 2, RECORD)), (4, 5), INTERVAL_S)
    with pytest.raises(AnalysisError, match="differ in ports or sample rate"):
        examine(
            TwinRuns({**given.runs, "scenes": other}, given.protocols, 1, 2),
            Settings.model_validate({"curves": [curve()], "film": FILM}),
        )


def test_more_wavelengths_and_longer_windows_help(tmp_path: Path) -> None:
    shots = list(STILL.shots(images_for(STILL)))
    shape = RunShape(len(shots), (PORTS, PORTS), WINDOW, INTERVAL_S, "int16", wavelengths_nm=(1550.0, 1551.0))
    columns = {name: np.array([getattr(shot, name) for shot in shots]) for name in ("dataset_index", "label", "group")}
    plan = shot_table(
        kind=np.array([str(shot.kind) for shot in shots]), wavelength_nm=np.full(len(shots), 1550.0), **columns
    )
    drive = Drive("drive", np.zeros(50, np.float32), 25e9, 0.5)
    manifest = {"protocol": "synthetic", "started": "2026-11-21T09:15:00Z", "seed": 1, "twin_seed": 1}
    with RunWriter.create(tmp_path / "run", manifest, shape, plan, drive, Durability(shots=100, seconds=99)) as writer:
        for wavelength in (0, 1):
            writer.scales(wavelength, 1e-3, 0.0)
            columns_of = slice(2 * WINDOW * wavelength, 2 * WINDOW * (wavelength + 1))
            codes = codes_of(pixels_of(shots), columns_of).astype(np.int16)
            none = np.zeros(codes.shape[:2])
            writer.append(
                wavelength, 0, Frames(codes, none, np.arange(len(codes), dtype=np.float64), none.astype(bool)), 1
            )
    both = {"windows": ["0.2 ns", "1 ns"], "network_windows": ["0.2 ns"], "paper": None}
    settings = Settings.model_validate(
        {
            "curves": [
                curve(key="one", label="L = 1", wavelengths=1, **both),
                curve(key="two", label="L = 2", wavelengths=2, **both),
            ],
            "examples": 1,
        }
    )
    found = examine(TwinRuns({"still": tmp_path / "run"}, {"still": STILL}, 1, 1), settings)
    assert found.film is None
    concluded = conclude([found], settings)
    one, two = (concluded.here[key]["linear"] for key in ("one", "two"))
    assert two["1.0"]["mean"] < one["1.0"]["mean"] < one["0.2"]["mean"]
    assert list(concluded.here["one"]["network"]) == ["0.2"]
    assert [figure.stem for figure in concluded.figures] == ["images-still", "errors", "rmse"]


def test_it_needs_torch() -> None:
    assert ANALYSIS.needs_torch
