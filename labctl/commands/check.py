"""`labctl check`: is every instrument of the station there and well?"""

import math
from collections.abc import Iterator
from typing import Annotated, Any

import typer

from labctl.bench.check import NOT_RUN, QUICK_S, check_bench
from labctl.bench.check import as_json as in_json
from labctl.bench.station import read_station
from labctl.commands.access import AttendedOption, access_of
from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.options import StationOption
from labctl.commands.output import JsonOption, say, show, table, tell
from labctl.runs.live.logs import CommandLog

DeepOption = Annotated[bool, typer.Option("--deep", help="Self-tests that take minutes, too.")]


def check(
    context: typer.Context,
    station: StationOption = None,
    attended: AttendedOption = False,
    deep: DeepOption = False,
    as_json: JsonOption = False,
) -> int:
    """Connect, identify and self-test every instrument; no light is switched on."""
    with CommandLog() as log:
        checked = check_bench(
            read_station(station),
            log,
            access_of(context, attended=attended),
            patience_s=math.inf if deep else QUICK_S,
            begins=_tell_of_minutes,
        )
    findings = {name: in_json(finding) for name, finding in checked.items()}
    well = all(finding["ok"] for finding in findings.values())
    show({"ok": well, "instruments": findings}, as_json, lambda: _print(findings))
    return DONE if well else FELL_SHORT


def _tell_of_minutes(name: str, takes_s: float) -> None:
    if takes_s > QUICK_S:
        tell(f"{name}: tests itself, which may take {takes_s / 60:.0f} minutes; Ctrl-C stops waiting for it")


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
        say(found["problem"] or f"{name}: {_self_test(found)}, no errors queued")


def _self_test(found: dict[str, Any]) -> str:
    if found["self_test"] != NOT_RUN:
        return f"self-test {found['self_test']}"
    return f"self-test not run (it may take {found['self_test_s'] / 60:.0f} minutes: labctl check --deep)"


def _limits(name: str, found: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for what, limit in found["limits"].items():
        low, high = ("" if bound is None else f"{bound:g}" for bound in (limit["low"], limit["high"]))
        yield name, what, f"{low} to {high}", limit["unit"]
