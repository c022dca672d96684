import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.studies.paper.traces import Settings, conclude, examine, noise_variance, smallest_ratio
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.image_readout import ImageReadout

WriteRun = Callable[..., Path]
NOISE = 3.0
STEP = 60


def twin_runs(folder: Path, write_run: WriteRun, *, seeds: tuple[int, int] = (1, 1)) -> TwinRuns:
    """Class k has a level of k times `STEP` codes before the chip and twice that behind it."""
    protocols, runs = {}, {}
    for name, ports, factor, seed in (("input", (0,), 1, seeds[0]), ("chip", (2, 3), 2, seeds[1])):
        protocol = ImageReadout(images=4, ports=ports, reference_every=1, seed=seed)
        shots = list(protocol.shots(images_for(protocol)))
        levels = np.array([shot.label for shot in shots])[:, None, None] * STEP * factor
        noise = np.random.default_rng(1).normal(0, NOISE, (len(shots), len(ports), 200))
        protocols[name] = protocol
        runs[name] = write_run(folder / name, shots, np.round(levels + noise), ports, 40e-12)
    return TwinRuns(runs, protocols, 1, 1)


def test_the_classes_that_are_most_alike_are_compared_with_the_noise(tmp_path: Path, write_run: WriteRun) -> None:
    findings = examine(twin_runs(tmp_path, write_run), Settings())
    assert findings.ports == (0, 2, 3)
    assert findings.volts.shape == (4, 3, 200)
    assert findings.classes.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(findings.volts[:, 0].mean(axis=-1), STEP * 1e-3 * np.arange(4), atol=1e-3)
    assert findings.input_ratio == pytest.approx(STEP / NOISE, rel=0.1)
    assert findings.chip_ratio == pytest.approx(2 * STEP / NOISE, rel=0.1)
    concluded = conclude([findings, findings], Settings())
    assert concluded.here["input"]["mean"] == concluded.here["input"]["least"] == findings.input_ratio
    assert [figure.stem for figure in concluded.figures] == ["traces"]


def test_runs_of_other_images_are_refused(tmp_path: Path, write_run: WriteRun) -> None:
    with pytest.raises(AnalysisError, match="not measured before the chip: give both runs one seed"):
        examine(twin_runs(tmp_path, write_run, seeds=(1, 2)), Settings())


def test_frames_that_a_simulated_bench_repeats_bit_for_bit_count_once() -> None:
    one, other = np.random.default_rng(1).normal(0, 2.0, (2, 3, 4000))
    assert noise_variance(np.stack([one, other, one, one])) == pytest.approx(4.0, rel=0.1)
    with pytest.raises(AnalysisError, match="set reference_every to 1"):
        noise_variance(np.stack([one, one]))


def test_the_smallest_of_all_differences_counts() -> None:
    traces = np.zeros((3, 2, 5))
    traces[1], traces[2] = 10.0, 13.0
    assert smallest_ratio(traces, np.array([0.25, 0.25])) == pytest.approx(math.sqrt(36 - 2))


def test_records_of_one_image_differ_by_nothing() -> None:
    noise = np.random.default_rng(2).normal(0, 0.5, (2, 2, 20_000))
    assert smallest_ratio(noise, np.array([0.25, 0.25])) < 0.3, "each has the noise, by which they differ"
    one, other = noise
    assert smallest_ratio(np.stack([one, other + 1.0]), np.array([0.25, 0.25])) == pytest.approx(2.0, rel=0.02)
