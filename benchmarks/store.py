"""How many requests and bytes it costs to look at runs in a store.

    python -m benchmarks.store

A hundred runs of 200 images on an S3 on this machine: listed, listed again, one opened, its frames of ten shots read,
and shown. The reference is what lies there.
"""

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fsspec

from labctl.bench.station import SIMULATED_STATION
from labctl.commands.main import main as labctl
from labctl.engine.session import Acquisition, acquire
from labctl.runs.catalogue import Catalogue
from labctl.runs.format.store import location
from labctl.runs.read.run import open_run
from protocols.image_readout import ImageReadout
from tests.stores import Traffic, account, s3

RUNS = 100
LAB = "s3://bucket/lab"
RUN = f"{LAB}/run-000"


def cost(traffic: Traffic, what: Callable[[], object]) -> dict[str, Any]:
    """Of one thing that is done: requests, bytes that came, s."""
    traffic.forget()
    began = time.perf_counter()
    what()
    return {
        "requests": len(traffic.requests),
        "bytes": traffic.bytes,
        "s": round(time.perf_counter() - began, 2),
    }


def ten_shots() -> None:
    """Those in the middle of a run."""
    with open_run(RUN) as run:
        run.volts(slice(100, 110))


def shown() -> None:
    """As it is typed."""
    try:
        labctl(["show", RUN, "--json"])
    except SystemExit as ended:
        if ended.code:
            raise


def main() -> None:
    """Measure and print one JSON object."""
    with tempfile.TemporaryDirectory() as place, s3() as (address, traffic):
        os.environ |= account(address) | {"XDG_CACHE_HOME": place}
        template = Path(place) / "run"
        acquire(Acquisition(ImageReadout(images=200), SIMULATED_STATION, template))
        os.chdir(place)
        system = fsspec.filesystem("s3")
        system.mkdir("bucket")
        files = {path.relative_to(template): path.read_bytes() for path in template.rglob("*") if path.is_file()}
        system.pipe({f"bucket/lab/run-{n:03d}/{name}": data for n in range(RUNS) for name, data in files.items()})
        result = {
            "runs": RUNS,
            "files": RUNS * len(files),
            "bytes_there": RUNS * sum(map(len, files.values())),
            "bytes_of_one": sum(map(len, files.values())),
            "listed": cost(traffic, lambda: Catalogue(location(LAB)).find()),
            "listed_again": cost(traffic, lambda: Catalogue(location(LAB)).find()),
            "opened": cost(traffic, lambda: open_run(RUN).close()),
            "ten_shots": cost(traffic, ten_shots),
            "shown": cost(traffic, shown),
        }
    sys.stderr.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
