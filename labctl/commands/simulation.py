"""`labctl sim serve`: the simulated bench as a service."""

import threading
from pathlib import Path
from typing import Annotated

import typer

from labctl.commands.output import JsonOption, say, show, table
from labctl.commands.run import StationOption
from labctl.failures import DONE
from labctl.interruption import on_stop_signal
from labctl.opening import simulated_bench
from labctl.station import SimSection, read_station, write_addresses

POLL_S = 0.5

app = typer.Typer(help="The simulated bench.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def simulation() -> None:
    """The simulated bench."""


@app.command()
def serve(
    station: StationOption = None,
    twin_seed: Annotated[int | None, typer.Option("--twin-seed", help="Which fibre, chip and noise.")] = None,
    port_base: Annotated[
        int | None, typer.Option("--port-base", min=1024, max=65500, help="First TCP port; without it any free ones.")
    ] = None,
    save_station: Annotated[
        Path | None, typer.Option("--save-station", help="Write a station file that points at these instruments.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Serve every instrument on loopback until Ctrl-C or SIGTERM."""
    asked = read_station(station)
    if twin_seed is not None:
        asked = asked.model_copy(update={"sim": SimSection(twin_seed=twin_seed)})
    stop = threading.Event()
    with on_stop_signal(stop.set), simulated_bench(asked, port_base=port_base) as bench:
        if save_station is not None:
            write_addresses(save_station, {name: found["socket"] for name, found in bench.resources.items()})
        resources = bench.resources
        show(
            {"resources": resources},
            as_json,
            lambda: table(
                ("instrument", "socket", "hislip"),
                ((name, found["socket"], found["hislip"]) for name, found in resources.items()),
            ),
        )
        if not as_json:
            say("serving; Ctrl-C ends")
        while bench.running and not stop.wait(POLL_S):
            pass
    return DONE
