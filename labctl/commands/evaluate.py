"""`labctl evaluate`: what a run says, by itself or with a readout."""

from pathlib import Path
from typing import Annotated, Any

import typer

from labctl.commands import train
from labctl.commands.exit_status import DONE
from labctl.commands.next_steps import cannot_judge, protocol_of, require_readout
from labctl.commands.output import JsonOption, say, show
from labctl.errors import UsageError
from labctl.studies.fibre import in_words, measure_fibre
from protocols.base import Judgement
from protocols.registry import judgement_of


def evaluate(
    subject: Annotated[
        Path, typer.Argument(metavar="MODEL|RUN", help="Model file that labctl train wrote, or a run directory.")
    ],
    run: Annotated[
        Path | None, typer.Argument(metavar="RUN", help="With a model: run directory to test it on.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Say how good a result is.

    MODEL RUN: tests a readout on shots it has not seen, and its kind on random and forward-in-time splits, with
    controls. RUN of wavelength-scan: correlation against detuning, its half width, the fibre's delay spread.
    """
    if run is not None:
        require_readout(run)
        return train.evaluate(subject, run, as_json)
    if subject.is_file():
        raise UsageError(f"{subject}: a file is tested on a run: name the run directory behind it")
    if judgement_of(protocol := protocol_of(subject)) is not Judgement.ITSELF:
        raise cannot_judge(subject, protocol)
    found = measure_fibre(subject)
    show(found, as_json, lambda: _print(found))
    return DONE


def _print(found: dict[str, Any]) -> None:
    for line in in_words(found):
        say(line)
    say(f"report: {found['report']}")
