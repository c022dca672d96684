"""`labctl report`: the report of a run, made anew."""

from pathlib import Path
from typing import Annotated

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.next_steps import cannot_judge, protocol_of
from labctl.commands.output import JsonOption, say, show
from labctl.runs.format.layout import RunPaths
from labctl.studies.judgement import JUDGES
from protocols.registry import judgement_of


def report(
    run: Annotated[Path, typer.Argument(help="Run directory.")],
    as_json: JsonOption = False,
) -> int:
    """Write figures and report of a run, and say where they are: PNG and SVG for a screen, PDF for a journal's column.

    A run that is judged with a readout takes the first one in its folder models.
    """
    protocol = protocol_of(run)
    judge = JUDGES.get(judgement_of(protocol))
    made = judge(run) if judge is not None else None
    if made is None:
        raise cannot_judge(run, protocol)
    figures = RunPaths(run).figures
    found = {"run": str(run), "protocol": protocol, "report": made["report"], "figures": str(figures)}
    show(found, as_json, lambda: say(f"{found['report']}\nfigures, as PNG, SVG and PDF: {figures}"))
    return DONE
