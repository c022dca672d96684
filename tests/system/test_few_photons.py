"""A receiver that counts: the bench measures at a few photons a sample, and the records say how many they were."""

import json
from pathlib import Path
from typing import Any

import pytest

from labctl.analysis.photons import photon_transfer
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run
from sim_backends.optics.receiver import ELEMENTARY_CHARGE, noise_bandwidth
from sim_backends.parameters import Parameters

COUNTS = {
    "amplifier_gain_db": 0.0,
    "booster_gain_db": 23.0,
    "detector_nep_w_per_rthz": 0.0,
    "detector_limit_v": 100.0,
    "enob": 7.0,
    "trigger_jitter_s": 0.0,
}
LEVELS = {"a photon": (26.6, 4.5e6), "ten photons": (16.6, 4.5e5)}
"""Loss in front of the mirrors (dB) and gain of the detector (V/W)."""


@pytest.mark.parametrize("level", LEVELS)
def test_photons_are_counted_as_the_twin_has_them(level: str, labctl: Any, tmp_path: Path) -> None:
    loss_db, gain_v_per_w = LEVELS[level]
    changed = COUNTS | {"fibre_loss_db": loss_db, "detector_gain_v_per_w": gain_v_per_w}
    table = ", ".join(f"{name} = {json.dumps(value)}" for name, value in changed.items())
    station = tmp_path / "bench.toml"
    station.write_text(f"[wiring]\nburst = true\n[sim]\nparameters = {{ {table} }}\n", "utf-8")
    asked = ("images=200", "ports=2-6", "window=2 ns", "reference_every=4", "timing=burst")
    settings = [word for setting in asked for word in ("--set", setting)]
    status, told = labctl("run", "image-readout", *settings, "--station", station, "--out", tmp_path / "run")
    assert status == 0, told
    with open_run(tmp_path / "run") as run:
        references, dark = read_records(run, "reference"), read_records(run, "dark")
    scale = photon_transfer(references.traces, dark.traces)
    twin = Parameters(**changed)
    bandwidth = noise_bandwidth(twin.detector_bandwidth_hz, twin.scope_bandwidth_hz)
    expected_v = 2 * ELEMENTARY_CHARGE * bandwidth * gain_v_per_w / twin.detector_responsivity_a_per_w
    assert scale.volts_per_photon == pytest.approx(expected_v, rel=0.2)
    assert scale.volts_per_photon.mean() == pytest.approx(expected_v, rel=0.08)
