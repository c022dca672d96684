"""The command `labctl`: its commands, and how every one of them ends."""

import json
import sys
from collections.abc import Sequence

import typer
from typer.exceptions import Abort, TyperException

from labctl.commands import (
    bench,
    data,
    evaluate,
    readout,
    recording,
    report,
    reproduce,
    resume,
    run,
    runs,
    simulation,
    verify,
)
from labctl.failures import EXPECTED, INTERRUPTED, WRONG_USE, exit_status, notes, one_line

app = typer.Typer(
    name="labctl",
    help="Runs a photonic machine-vision bench, real or simulated. Without --station the simulated bench is used.",
    epilog="Errors are one line; --debug, anywhere on the line, adds the traceback.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command("demo")(run.demo)
app.command("reproduce")(reproduce.reproduce)
app.command("check")(bench.check)
app.command("run")(run.run)
app.command("resume")(resume.resume)
app.command("verify")(verify.verify)
app.command("runs")(runs.runs)
app.command("show")(runs.show)
app.command("train")(readout.train)
app.command("evaluate")(evaluate.evaluate)
app.command("report")(report.report)
app.command("record")(recording.record)
app.command("replay")(recording.replay)
app.add_typer(data.app, name="data")
app.add_typer(simulation.app, name="sim")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command and end the process with its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    sys.exit(_status([word for word in words if word != "--debug"], debug=debug))


def _status(words: list[str], *, debug: bool) -> int:
    try:
        status = app(words, standalone_mode=False)
    except (KeyboardInterrupt, Abort):
        return INTERRUPTED
    except TyperException as error:
        return _complain(f"{error.format_message()} `labctl --help` lists what there is", WRONG_USE, words)
    except EXPECTED as error:
        if debug:
            raise
        return _complain(one_line(error), exit_status(error), words, notes(error))
    return status if isinstance(status, int) else 0


def _complain(message: str, status: int, words: list[str], beside: Sequence[str] = ()) -> int:
    for line in (message, *beside):
        sys.stderr.write(f"labctl: {line}\n")
    if "--json" in words:
        told = {"error": message, "exit": status} | ({"notes": list(beside)} if beside else {})
        sys.stdout.write(json.dumps(told) + "\n")
    return status
