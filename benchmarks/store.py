"""How many requests and bytes it costs to look at runs in a store.

A hundred runs of 200 images on an S3 on this machine: listed, listed again, one opened, its frames of ten shots read,
and shown. The reference is what lies there.
"""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from pathlib import Path

import fsspec

from benchmarks.rows import Row
from labctl.bench.station import SIMULATED_STATION
from labctl.commands.main import main as labctl
from labctl.engine.session import Acquisition, acquire
from labctl.runs.catalogue import Catalogue
from labctl.runs.format.store import location
from labctl.runs.read.run import open_run
from protocols.image_readout import ImageReadout
from tests.stores import account, s3

RUNS = 100
LAB = "s3://bucket/lab"
RUN = f"{LAB}/run-000"


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


def rows() -> Iterator[Row]:
    """Two rows for each thing that is done: requests, and bytes that came."""
    with tempfile.TemporaryDirectory() as place, s3() as (address, traffic):
        os.environ |= account(address) | {"XDG_CACHE_HOME": place}
        template = Path(place) / "run"
        acquire(Acquisition(ImageReadout(images=200), SIMULATED_STATION, template))
        os.chdir(place)
        system = fsspec.filesystem("s3")
        system.mkdir("bucket")
        files = {path.relative_to(template): path.read_bytes() for path in template.rglob("*") if path.is_file()}
        system.pipe({f"bucket/lab/run-{n:03d}/{name}": data for n in range(RUNS) for name, data in files.items()})
        of_one = sum(map(len, files.values()))
        done: dict[str, tuple[Callable[[], object], int]] = {
            f"{RUNS} runs listed": (lambda: Catalogue(location(LAB)).find(), RUNS),
            f"{RUNS} runs listed again": (lambda: Catalogue(location(LAB)).find(), RUNS),
            "one run opened": (lambda: open_run(RUN).close(), 1),
            "ten shots of it read": (ten_shots, 1),
            "one run shown": (shown, 1),
        }
        for what, (action, runs) in done.items():
            traffic.forget()
            with redirect_stdout(sys.stderr):
                action()
            there = f"of {'them' if runs > 1 else 'it'} in the store"
            yield Row(what, len(traffic.requests), "requests", against=f"files {there}", reference=runs * len(files))
            yield Row(what, traffic.bytes / 1e6, "MB", against=there, reference=runs * of_one / 1e6)
