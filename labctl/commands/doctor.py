"""`labctl doctor`: does labctl itself work on this machine, and what could it not do?"""

from collections.abc import Sequence
from dataclasses import asdict

from labctl.bench.environment import BROKEN, OK, Finding, examine
from labctl.commands.exit_status import DONE, FELL_SHORT
from labctl.commands.output import JsonOption, say, show, table


def doctor(as_json: JsonOption = False) -> int:
    """Say what works here: Python, packages, VISA, drivers, extras, data sets; exit 1 if labctl itself cannot work."""
    findings = examine()
    works = all(found.state != BROKEN for found in findings)
    result = {"ok": works, "findings": [asdict(found) for found in findings]}
    show(result, as_json, lambda: _print(findings, works))
    return DONE if works else FELL_SHORT


def _print(findings: Sequence[Finding], works: bool) -> None:
    table(
        ("", "what", "", "finding"),
        (
            (found.about, found.name, found.state if found.state == OK else found.state.upper(), found.says)
            for found in findings
        ),
    )
    say("labctl works here, without what is MISSING" if works else "labctl cannot work here: repair what is BROKEN")
