"""The simulated bench."""

import ipaddress
from typing import Annotated

import typer

from labctl.bench.signals import stops_heard
from labctl.bench.simulation import known_faults, simulated_bench, without_card
from labctl.bench.station import read_station, write_addresses
from labctl.commands.exit_status import DONE
from labctl.commands.options import PortBaseOption, SaveStationOption, StationOption
from labctl.commands.output import JsonOption, say, show, table, warn
from labctl.commands.service import serving
from labctl.errors import UsageError

POLL_S = 0.5
LOOPBACK = "127.0.0.1"
LIST = "list"

app = typer.Typer(help=__doc__, no_args_is_help=True, rich_markup_mode=None, add_completion=False)


@app.callback()
def simulation() -> None:
    """The simulated bench."""


@app.command()
def serve(
    station: StationOption = None,
    twin_seed: Annotated[int | None, typer.Option("--twin-seed", min=0, help="Which fibre, chip and noise.")] = None,
    projector: Annotated[
        bool | None,
        typer.Option("--projector/--no-projector", help="Fibre and DMD in the light's way, or straight into the chip."),
    ] = None,
    port_base: PortBaseOption = None,
    save_station: SaveStationOption = None,
    host: Annotated[
        str, typer.Option("--host", help="Address of this machine to listen on; the default is this machine alone.")
    ] = LOOPBACK,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            help="Let an instrument fail, as INSTRUMENT:FAULT[@MESSAGE][,nth=N][,times=N][,byte=N]; may be repeated. "
            "'list' says which faults there are.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Serve every instrument until Ctrl-C or SIGTERM; on loopback, unless --host names another address."""
    if fault == [LIST]:
        return _list_faults(as_json)
    if not _is_loopback(host):
        warn(f"anyone who reaches {host} can drive these instruments: nobody is asked who they are")
    asked = read_station(station)
    if twin_seed is not None:
        asked = asked.twin(twin_seed)
    if projector is not None:
        asked = asked.cabled(projector=projector)
    with (
        stops_heard() as stopped,
        serving(
            simulated_bench(asked, host=host, port_base=port_base, faults=fault or ()), "--host, --port-base"
        ) as bench,
    ):
        if bench.world.fallback:
            warn(without_card(bench.world.fallback))
        if save_station is not None:
            write_addresses(save_station, {name: found["socket"] for name, found in bench.resources.items()}, asked)
        resources = bench.resources
        show(
            {"resources": resources},
            as_json,
            lambda: table(
                ("instrument", "transport", "address"),
                ((name, transport, at) for name, found in resources.items() for transport, at in found.items()),
            ),
        )
        if not as_json:
            say("serving; Ctrl-C ends")
        while bench.running and not stopped(POLL_S):
            pass
    return DONE


def _list_faults(as_json: bool) -> int:
    faults = known_faults()
    show(
        {"faults": [one._asdict() for one in faults]},
        as_json,
        lambda: table(
            ("fault", "instruments", "strikes at", "what happens"),
            ((one.name, ", ".join(one.instruments), one.at, one.told) for one in faults),
        ),
    )
    return DONE


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.IPv4Address(host).is_loopback
    except ipaddress.AddressValueError:
        raise UsageError(
            f"--host = {host!r}: give an address of this machine in four numbers, such as {LOOPBACK}"
        ) from None
