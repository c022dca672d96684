"""`labctl report`: the report of a run, made anew."""

from labctl.commands.exit_status import DONE
from labctl.commands.next_steps import cannot_judge, protocol_of
from labctl.commands.options import RunHereArgument
from labctl.commands.output import JsonOption, say, show
from labctl.runs.format.layout import RunPaths
from labctl.studies.judgement import JUDGES


def report(
    run: RunHereArgument,
    as_json: JsonOption = False,
) -> int:
    """Write figures and report of a run, and say where they are: PNG and SVG for a screen, PDF for a journal's column.

    A run that is judged with a readout takes the first one in its folder models.
    """
    protocol, judgement = protocol_of(run)
    judge = JUDGES.get(judgement)
    made = judge(run) if judge is not None else None
    if made is None:
        raise cannot_judge(run)
    figures = RunPaths(run).figures
    found = {"run": str(run), "protocol": protocol, "report": str(made["report"]), "figures": str(figures)}
    show(found, as_json, lambda: _say(found))
    return DONE


def _say(found: dict[str, str]) -> None:
    say(found["report"])
    say(f"figures, as PNG, SVG and PDF: {found['figures']}")
