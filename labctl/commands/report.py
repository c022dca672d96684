"""`labctl report`: the report of a run, made anew."""

from labctl.commands.exit_status import DONE
from labctl.commands.next_steps import cannot_judge, protocol_of
from labctl.commands.options import RunHereArgument
from labctl.commands.output import JsonOption, say, show
from labctl.studies.judgement import JUDGES


def report(
    run: RunHereArgument,
    as_json: JsonOption = False,
) -> int:
    """Write figures and report of a run, and say where they are.

    A run that is judged with a readout takes the first one in its folder models.
    """
    protocol, judgement = protocol_of(run)
    judge = JUDGES.get(judgement)
    made = judge(run) if judge is not None else None
    if made is None:
        raise cannot_judge(run)
    found = {"run": str(run), "protocol": protocol, "report": made["report"]}
    show(found, as_json, lambda: say(str(found["report"])))
    return DONE
