"""`labctl doctor`: does labctl itself work on this machine, and what could it not do?"""

from dataclasses import asdict

from labctl.commands.output import JsonOption, show, table
from labctl.environment import BROKEN, OK, examine
from labctl.failures import DONE, FELL_SHORT


def doctor(as_json: JsonOption = False) -> int:
    """Say what works here: Python, packages, VISA, drivers, extras, data sets; exit 1 if labctl itself cannot work."""
    findings = examine()
    works = all(found.state != BROKEN for found in findings)
    show(
        {"ok": works, "findings": [asdict(found) for found in findings]},
        as_json,
        lambda: table(
            ("", "what", "", "finding"),
            (
                (found.about, found.name, found.state if found.state == OK else found.state.upper(), found.says)
                for found in findings
            ),
        ),
    )
    return DONE if works else FELL_SHORT
