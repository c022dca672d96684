"""A run as one task among others: what it leaves behind."""

import gc
from pathlib import Path

from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition
from labctl.studies.run_tasks import acquire_run
from labctl.studies.tasks import CALLER
from protocols.image_readout import ImageReadout
from sim_backends.world.twin import Twin


class Alone:
    """Waits for the run, and wants nothing of it."""

    scratch: Path | None = None

    def stopped(self) -> bool:
        return False

    def measured(self, records: int) -> None:
        pass


def test_the_simulated_bench_is_gone_when_its_run_is_over(tmp_path: Path) -> None:
    gc.collect()
    others = {id(found) for found in gc.get_objects() if type(found) is Twin}
    gc.disable()
    caller = CALLER.set(Alone())
    try:
        acquire_run(Acquisition(ImageReadout(images=8, window=0.4e-9), SIMULATED_STATION, tmp_path / "run"))
        left = [found for found in gc.get_objects() if type(found) is Twin and id(found) not in others]
    finally:
        CALLER.reset(caller)
        gc.enable()
    assert not left
