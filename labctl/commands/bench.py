"""`labctl check`: is every instrument of the station there and well?"""

from typing import Annotated, Any

import typer

from instruments.errors import InstrumentError
from instruments.interfaces import Instrument
from labctl.command_log import CommandLog
from labctl.commands.options import StationOption
from labctl.commands.output import JsonOption, show, table
from labctl.failures import DONE, FELL_SHORT
from labctl.opening import opened
from labctl.station import read_station


def check(
    station: StationOption = None,
    attended: Annotated[bool, typer.Option("--attended", help="Somebody stands at the laser's key switch.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Connect, identify and self-test every instrument; no light is switched on."""
    with CommandLog() as log, opened(read_station(station), log, attended=attended) as open_bench:
        findings = {name: _check(instrument) for name, instrument in open_bench.bench.instruments.items()}
    well = all(finding["ok"] for finding in findings.values())
    show(
        {"ok": well, "instruments": findings},
        as_json,
        lambda: table(
            ("instrument", "", "identity", "finding"),
            (
                (name, "ok" if found["ok"] else "FAILS", found["identity"], found["problem"] or "self-test passed")
                for name, found in findings.items()
            ),
        ),
    )
    return DONE if well else FELL_SHORT


def _check(instrument: Instrument) -> dict[str, Any]:
    identity = ""
    try:
        identity = " ".join(part for part in vars(instrument.identify()).values() if part)
        instrument.self_test()
    except InstrumentError as error:
        return {"ok": False, "identity": identity, "problem": str(error)}
    return {"ok": True, "identity": identity, "problem": ""}
