"""`labctl report`: the report of a run, made anew."""

from pathlib import Path
from typing import Annotated

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.next_steps import cannot_judge, models_of, protocol_of
from labctl.commands.output import JsonOption, say, show
from labctl.studies.fibre import measure_fibre
from labctl.studies.readouts import evaluate_readout
from protocols.image_readout import ImageReadout
from protocols.wavelength_scan import WavelengthScan


def report(
    run: Annotated[Path, typer.Argument(help="Run directory.")],
    as_json: JsonOption = False,
) -> int:
    """Write figures and report of a run, and say where they are.

    A run of image-readout is judged with the first readout in its folder models.
    """
    protocol = protocol_of(run)
    if protocol == WavelengthScan.name:
        made = measure_fibre(run)
    elif protocol == ImageReadout.name and (models := models_of(run)):
        made = evaluate_readout(models[0], run)
    else:
        raise cannot_judge(run, protocol)
    found = {"run": str(run), "protocol": protocol, "report": made["report"]}
    show(found, as_json, lambda: say(str(found["report"])))
    return DONE
