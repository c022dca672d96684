"""`labctl check`: is every instrument of the station there and well?"""

from collections.abc import Iterator
from typing import Any

import typer

from labctl.bench.check import as_json as in_json
from labctl.bench.check import check_bench
from labctl.bench.station import read_station
from labctl.commands.access import AttendedOption, access_of
from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.options import StationOption
from labctl.commands.output import JsonOption, say, show, table
from labctl.runs.live.logs import CommandLog


def check(
    context: typer.Context,
    station: StationOption = None,
    attended: AttendedOption = False,
    as_json: JsonOption = False,
) -> int:
    """Connect, identify and self-test every instrument; no light is switched on."""
    with CommandLog() as log:
        checked = check_bench(read_station(station), log, access_of(context, attended=attended))
    findings = {name: in_json(finding) for name, finding in checked.items()}
    well = all(finding["ok"] for finding in findings.values())
    show({"ok": well, "instruments": findings}, as_json, lambda: _print(findings))
    return DONE if well else FELL_SHORT


def _print(findings: dict[str, dict[str, Any]]) -> None:
    table(
        ("instrument", "", "address", "identity", "serial", "firmware", "options"),
        (
            (
                name,
                "ok" if found["ok"] else "FAILS",
                found["address"],
                f"{found['manufacturer']} {found['model']}".strip(),
                found["serial"],
                found["firmware"],
                found["options"],
            )
            for name, found in findings.items()
        ),
    )
    say("")
    table(
        ("instrument", "kept within", "", ""), (row for name, found in findings.items() for row in _limits(name, found))
    )
    say("")
    for name, found in findings.items():
        say(found["problem"] or f"{name}: self-test passed, no errors queued")


def _limits(name: str, found: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for what, limit in found["limits"].items():
        low, high = ("" if bound is None else f"{bound:g}" for bound in (limit["low"], limit["high"]))
        yield name, what, f"{low} to {high}", limit["unit"]
