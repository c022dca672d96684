"""Who carries out what can be done side by side."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from labctl.bench.signals import UNDER_WAY, interruptible
from labctl.commands.output import tell
from labctl.commands.progress import progress_bar
from labctl.errors import UsageError
from labctl.runs.format.store import is_elsewhere, location

if TYPE_CHECKING:
    from labctl.studies.tasks import Engine

Name = TypeVar("Name")
Found = TypeVar("Found")

LOCAL = "local"
SideBySideOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Side by side: by the workers of a dask scheduler, or by the cores here (local).",
    ),
]
SchedulerOption = Annotated[
    str,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Of a dask scheduler, such as tcp://host:8786, whose workers do it; local: the cores of this machine.",
    ),
]


def _lasting(named: str) -> Path:
    if named.startswith("memory://"):
        raise UsageError(
            f"--store = {named}: is gone with the process that puts a run there: name a folder, or a store as s3:// or "
            "sftp://"
        )
    return location(named)


StoreOption = Annotated[
    Path | None,
    typer.Option(
        "--store",
        metavar="FOLDER|URL",
        help="Where whoever measures a run puts it, whole: a folder that all see, or a URL such as s3://bucket/runs.",
        parser=_lasting,
    ),
]


def engine_of(scheduler: str, *modules: str, store: Path | None = None) -> "Engine":
    """What `--scheduler` names; if it is processes of this machine, they load `modules` from now on.

    Into a folder that is a `store` other commands may put the same runs, so that none is measured in its place.

    Raises:
        UsageError: dask is not installed.
    """
    from labctl.studies.cluster import cluster
    from labctl.studies.processes import load_meanwhile, processes

    if scheduler != LOCAL:
        return cluster(scheduler, tell)
    if modules:
        load_meanwhile(*modules)
    return processes if store is None or is_elsewhere(store) else partial(processes, scratch=store)


def carrying(scheduler: str | None, title: str) -> Callable[[Mapping[Name, Callable[[], Found]]], dict[Name, Found]]:
    """What carries out tasks under a bar called so: what `--scheduler` names, or this process one after the other.

    Raises:
        UsageError: dask is not installed.
    """
    from labctl.studies.tasks import Interrupted, in_parallel, one_by_one

    if scheduler is None:
        return one_by_one
    engine = engine_of(scheduler)

    def carried_out(tasks: Mapping[Name, Callable[[], Found]]) -> dict[Name, Found]:
        with interruptible(UNDER_WAY) as interruption, progress_bar(title) as bar:
            try:
                found = in_parallel(
                    tasks,
                    engine=engine,
                    interruption=interruption,
                    progress=lambda done, _records: bar.progress(done, len(tasks)),
                )
            except Interrupted:
                raise KeyboardInterrupt from None
        return {name: result for name, (result, _) in found.items()}

    return carried_out
