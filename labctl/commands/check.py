"""`labctl check`: is every instrument of the station there and well, and does it do what labctl takes for granted?"""

import math
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from labctl.bench.check import NOT_RUN, QUICK_S, check_bench
from labctl.bench.check import as_json as in_json
from labctl.bench.station import read_station
from labctl.commands.access import ArmOption, AttendedOption, access_of
from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.options import StationOption
from labctl.commands.output import JsonOption, say, show, table, tell
from labctl.errors import UsageError
from labctl.runs.live.logs import CommandLog

if TYPE_CHECKING:
    from labctl.studies.open_questions import Asked

DeepOption = Annotated[
    bool,
    typer.Option(
        "--deep", help="Self-tests that take minutes too, and what documents leave open; with light if --arm."
    ),
]


def check(
    context: typer.Context,
    station: StationOption = None,
    attended: AttendedOption = False,
    deep: DeepOption = False,
    armed: ArmOption = False,
    as_json: JsonOption = False,
) -> int:
    """Connect, identify and self-test every instrument; without light, except with --deep --arm."""
    if armed and not deep:
        raise UsageError("--arm: this check needs no light: leave it out, or ask for --deep too")
    described, access, asked = read_station(station), access_of(context, attended=attended, armed=armed), None
    with CommandLog() as log:
        checked = check_bench(
            described,
            log,
            access,
            patience_s=math.inf if deep else QUICK_S,
            begins=_tell_of_minutes,
        )
        well = all(finding.ok for finding in checked.values())
        if deep and well:
            from labctl.studies.open_questions import ask_bench  # with protocols and data sets

            asked = ask_bench(described, log, access, light=armed)
    findings = {name: in_json(finding) for name, finding in checked.items()}
    result: dict[str, Any] = {"ok": well, "instruments": findings}
    if asked is not None:
        result |= {"answers": [asdict(answer) for answer in asked.answers], "kept_in": str(asked.path)}
    show(result, as_json, lambda: _print(findings, asked))
    agree = asked is None or all(answer.agrees for answer in asked.answers)
    return DONE if well and agree else FELL_SHORT


def _tell_of_minutes(name: str, takes_s: float) -> None:
    if takes_s > QUICK_S:
        tell(f"{name}: tests itself, which may take {takes_s / 60:.0f} minutes; Ctrl-C stops waiting for it")


def _print(findings: dict[str, dict[str, Any]], asked: "Asked | None") -> None:
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
        if found["emits"]:
            say(f"{name}: EMITS: somebody has left it on; the next run switches it off first")
    if asked is not None:
        say("")
        table(
            ("what documents leave open", "", "taken for granted", "found"),
            (
                (answer.question, "ok" if answer.agrees else "DIFFERS", answer.assumed, answer.found)
                for answer in asked.answers
            ),
        )
        say(f"kept in {asked.path}")


def _self_test(found: dict[str, Any]) -> str:
    if found["self_test"] != NOT_RUN:
        return f"self-test {found['self_test']}"
    return f"self-test not run (it may take {found['self_test_s'] / 60:.0f} minutes: labctl check --deep)"


def _limits(name: str, found: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for what, limit in found["limits"].items():
        low, high = ("" if bound is None else f"{bound:g}" for bound in (limit["low"], limit["high"]))
        yield name, what, f"{low} to {high}", limit["unit"]
