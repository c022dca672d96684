"""Noise is new for every trigger: references and darks of one run scatter as the twin's own noise model says."""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.bench.station import SIMULATED_STATION
from labctl.engine.inputs import images_for
from labctl.runs.read.run import open_run
from protocols.base import ShotKind
from protocols.image_readout import ImageReadout
from sim_backends.optics.receiver import digitiser_noise_codes
from tests.labctl.studies.alignment.world_truth import world

EACH = 200
ASKED = {"images": EACH, "reference_every": 1, "window": "0.8 ns", "ports": "2,3,4,5"}
PORTS = (2, 3, 4, 5)
KINDS = {"references": ShotKind.REFERENCE, "darks": ShotKind.DARK}


def expected_codes(reference: int, scale_v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of every sample, of the reference image and in the dark; (2, ports, samples).

    Receiver noise at the sample's own light, the trigger's jitter by the trace's slope, digitiser and rounding.
    """
    protocol = ImageReadout.model_validate(ASKED)
    images = images_for(protocol)
    picture = images.images[images.indices == reference][:1]
    shown = replace(images, images=np.concatenate([picture, np.zeros_like(picture)]))
    twin = world(SIMULATED_STATION, shown, PORTS)
    laws = twin.optics.laws
    light = np.maximum(twin.clean - twin.offset_v[:, np.newaxis], 0)
    jitter = math.hypot(twin.parameters.trigger_jitter_s, twin.parameters.awg_jitter_s) * twin.slope
    variance = laws.floor + laws.linear * light + laws.quadratic * light**2 + jitter**2
    volts = np.sqrt(variance)[..., : protocol.sample_count(images)]
    digitiser = digitiser_noise_codes(twin.parameters.enob) ** 2 + 1 / 12
    return np.asarray(np.sqrt((volts / scale_v[:, np.newaxis]) ** 2 + digitiser))


@pytest.mark.parametrize("timing", ["software", "burst"])
def test_references_and_darks_scatter_as_the_noise_model_says(timing: str, labctl: Any, tmp_path: Path) -> None:
    settings = [word for name, value in ASKED.items() for word in ("--set", f"{name}={value}")]
    status, _ = labctl("run", "image-readout", *settings, "--set", f"timing={timing}", "--out", tmp_path / "run")
    assert status == 0
    with open_run(tmp_path / "run") as run:
        shots, frames, scale_v = run.shots, run.frames[:], np.asarray(run.scale)
    reference = int(shots["dataset_index"][shots["kind"] == KINDS["references"]][0])
    for expected, (name, kind) in zip(expected_codes(reference, scale_v), KINDS.items(), strict=True):
        records = frames[shots["kind"] == kind]
        assert len(records) == EACH
        assert len(np.unique(records.reshape(EACH, -1), axis=0)) == EACH, "no two of them are the same"
        ratio = records.std(axis=0, ddof=1) / expected
        told = f"{timing}, {name}: measured over expected {np.sqrt(np.mean(ratio**2, axis=1)).round(3)} by port"
        sys.stdout.write(told + "\n")
        assert np.sqrt(np.mean(ratio**2, axis=1)) == pytest.approx(1.0, abs=0.1), told
        assert ratio == pytest.approx(1.0, abs=5 / np.sqrt(2 * EACH)), f"{told}, {ratio.min():.2f} to {ratio.max():.2f}"
