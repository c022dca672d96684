"""What a readout is trained on: the whole of a run, or as much of it as memory allows."""

from pathlib import Path

import numpy as np
import pytest

from labctl.bench.station import Station
from labctl.engine.session import Acquisition, acquire
from labctl.runs.read import records as module
from labctl.runs.read.records import read_records, resample
from labctl.runs.read.run import open_run
from protocols.image_readout import ImageReadout


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("runs") / "run"
    acquire(Acquisition(ImageReadout(images=40, window=0.4e-9, ports=(2, 3), reference_every=5), Station(), directory))
    return directory


@pytest.mark.parametrize("samples", [1 << 20, 60, 1])
@pytest.mark.parametrize("kind", ["image", "reference", "dark"])
def test_blocks_are_what_all_of_it_is_at_once(
    run: Path, kind: str, samples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "BLOCK_SAMPLES", samples)
    with open_run(run) as stored:
        found = read_records(stored, kind)
        chosen = np.flatnonzero(stored.shots["kind"] == kind)
        whole = resample(
            stored.volts()[chosen], stored.trigger_offset_s[chosen], sample_interval_s=found.sample_interval_s
        )
        np.testing.assert_allclose(found.traces, whole, rtol=1e-5, atol=1e-7)
        np.testing.assert_array_equal(found.groups, stored.shots["group"][chosen])
    np.testing.assert_array_equal(found.indices, chosen)


def test_what_is_left_out_is_spread_evenly(run: Path) -> None:
    with open_run(run) as stored:
        whole, some = read_records(stored), read_records(stored, most=14)
    places = np.searchsorted(whole.indices, some.indices)
    assert places.tolist() == list(range(0, 40, 3))
    np.testing.assert_array_equal(some.traces, whole.traces[places])
    np.testing.assert_array_equal(some.labels, whole.labels[places])
