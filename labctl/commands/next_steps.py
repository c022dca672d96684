"""What a run is good for: the command that leads on from it, by its protocol."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from labctl.errors import UsageError
from labctl.runs.format.layout import RunPaths
from labctl.runs.read.run import open_run
from labctl.studies.paper.experiments import experiments
from protocols.image_readout import ImageReadout
from protocols.wavelength_scan import WavelengthScan


def next_command(protocol: str, directory: Path) -> str:
    """What to type after a run of the protocol called so.

    Runs that are only judged together with others lead to the experiments that acquire all of them.

    Raises:
        ExperimentError: an experiment file is wrong.
    """
    where = shlex.quote(str(directory))
    if protocol == WavelengthScan.name:
        return f"labctl evaluate {where}"
    if protocol == ImageReadout.name:
        models = models_of(directory)
        return f"labctl evaluate {shlex.quote(str(models[0]))} {where}" if models else f"labctl train {where}"
    found = [one.name for one in experiments() if any(run.protocol == protocol for run in one.runs.values())]
    return f"labctl reproduce {' '.join(found)}" if found else f"labctl show {where}"


def resume_command(directory: Path, options: str = "") -> str:
    """What to type after a run that ended early, with the options that it was begun with."""
    return f"labctl resume {shlex.quote(str(directory))}{options}"


def options_again(*, attended: bool, armed: bool, data: Path | None, station: Path | None = None) -> str:
    """The options of a run that its manifest does not keep, as they are typed once more to go on with it."""
    places = {"--station": station, "--data": data}
    said = {"--attended": attended, "--arm": armed}
    named = [f" {option} {shlex.quote(str(place))}" for option, place in places.items() if place is not None]
    return "".join([*named, *(f" {option}" for option, given in said.items() if given)])


@contextmanager
def resumable(directory: Path, options: str = "") -> Iterator[None]:
    """Whatever ends the block early has a note with the command that goes on with the run it began in `directory`."""
    before = RunPaths(directory).journal.exists()
    try:
        yield
    except BaseException as error:
        if not before and RunPaths(directory).journal.exists():
            error.add_note(f"the run can go on: {resume_command(directory, options)}")
        raise


def models_of(directory: Path) -> list[Path]:
    """The readouts that were trained on a run, by name."""
    return sorted((directory / "models").glob("*.h5"))


def protocol_of(directory: Path) -> str:
    """Name of the protocol that made a run.

    Raises:
        UsageError: no such directory.
        RunError: not a run, or damaged.
    """
    if not directory.is_dir():
        raise UsageError(f"{directory}: no such directory: name a run directory, as 'labctl runs' lists them")
    with open_run(directory) as run:
        asked = run.manifest.get("protocol")
    return str(asked["name"]) if isinstance(asked, dict) and "name" in asked else "an unknown protocol"


def cannot_judge(directory: Path, protocol: str) -> UsageError:
    """The one line for a run that cannot be judged as asked: what its protocol needs, and what to type."""
    command = next_command(protocol, directory)
    needs = {
        ImageReadout.name: "is judged with a readout",
        WavelengthScan.name: "is judged without a readout",
    }
    if command.startswith("labctl reproduce"):
        why = "is judged by an experiment, which acquires all that it needs"
    else:
        why = needs.get(protocol, "is nothing that labctl can judge")
    return UsageError(f"{directory}: a run of {protocol} {why}: go on with '{command}'")
