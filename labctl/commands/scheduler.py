"""Who carries out what can be done side by side."""

from typing import TYPE_CHECKING, Annotated

import typer

from labctl.commands.output import tell

if TYPE_CHECKING:
    from labctl.studies.tasks import Engine

LOCAL = "local"
SchedulerOption = Annotated[
    str,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Of a dask scheduler, such as tcp://host:8786, whose workers do it; local: the cores of this machine.",
    ),
]


def engine_of(scheduler: str) -> "Engine":
    """What `--scheduler` names.

    Raises:
        UsageError: dask is not installed.
    """
    from labctl.studies.cluster import cluster
    from labctl.studies.processes import processes

    return processes if scheduler == LOCAL else cluster(scheduler, tell)
