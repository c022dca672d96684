"""What a run is good for: how its protocol says that it is judged, and the command that leads on from it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from labctl.errors import RunError, RunInUse, UsageError
from labctl.printable import typed, typed_path
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.read.run import open_run, refuse_file
from protocols.base import Judgement
from protocols.registry import judgement_of

OTHERWISE = (Judgement.ITSELF, Judgement.EXPERIMENT)
"""Than with a readout."""
_JUDGEMENTS = {one.value: one for one in Judgement}


def next_command(directory: Path) -> str:
    """What to type after a run.

    Runs that are only judged together with others lead to the experiments that acquire all of them.

    Raises:
        RunError: not a run, or damaged.
        ExperimentError: an experiment file is wrong.
    """
    return _judged(directory)[1]


def resume_command(directory: Path, options: str = "") -> str:
    """What to type after a run that ended early, with the options that it was begun with."""
    return f"labctl resume {typed_path(directory)}{options}"


def options_again(
    *, attended: bool, armed: bool, data: Path | None, station: Path | None = None, scheduler: str | None = None
) -> str:
    """The options of a run that its manifest does not keep, as they are typed once more to go on with it."""
    places = {"--station": station, "--data": data, "--scheduler": scheduler}
    said = {"--attended": attended, "--arm": armed}
    named = [f" {option} {typed(str(place))}" for option, place in places.items() if place is not None]
    return "".join([*named, *(f" {option}" for option, given in said.items() if given)])


@contextmanager
def resumable(directory: Path, options: str = "") -> Iterator[None]:
    """Whatever ends the block early has a note with the command that goes on, where `directory` was measured into."""
    before = _journal_bytes(directory)
    try:
        yield
    except BaseException as error:
        begun = RunPaths(directory).manifest.exists() and not isinstance(error, RunInUse)
        if begun and _journal_bytes(directory) != before and not is_replayed(directory):
            error.add_note(f"the run can go on: {resume_command(directory, options)}")
        raise


def is_replayed(directory: Path) -> bool:
    """Whether the records of a run are those of a recording, so that no bench goes on with it."""
    try:
        return Origin.of_runs([directory]) is Origin.REPLAYED
    except RunError:
        return False


def _journal_bytes(directory: Path) -> int | None:
    """How long the journal of a run is; None where there is none."""
    try:
        return RunPaths(directory).journal.stat().st_size
    except OSError:
        return None


def protocol_of(directory: Path) -> tuple[str, Judgement]:
    """Name of the protocol that made a run, and how it says that its runs are judged.

    Raises:
        UsageError: no such directory, or a file.
        RunError: not a run, or damaged.
    """
    refuse_file(directory)
    if not directory.is_dir():
        raise UsageError(f"{directory}: no such directory: name a run directory, as 'labctl runs' lists them")
    with open_run(directory) as run:
        asked = run.manifest.get("protocol")
    if not isinstance(asked, dict) or "name" not in asked:
        return "an unknown protocol", Judgement.NONE
    name = str(asked["name"])
    return name, _JUDGEMENTS.get(str(asked["judgement"]), Judgement.NONE) if "judgement" in asked else judgement_of(
        name
    )


def require_readout(directory: Path) -> None:
    """Refuse a run whose protocol says that it is judged in another way than with a readout.

    What is no run directory is left to whoever reads it.

    Raises:
        UsageError: it is judged in another way.
        RunError: not a run, or damaged.
    """
    if directory.is_dir() and protocol_of(directory)[1] in OTHERWISE:
        raise cannot_judge(directory)


def cannot_judge(directory: Path) -> UsageError:
    """The one line for a run that cannot be judged as asked: what its protocol needs, and what to type.

    Raises:
        UsageError: no such directory.
        RunError: not a run, or damaged.
    """
    how, command = _judged(directory)
    return UsageError(f"{directory}: a run of {protocol_of(directory)[0]} {how}: go on with '{command}'")


def _judged(directory: Path) -> tuple[str, str]:
    """How a run is judged, and the command that does so or comes first."""
    where = typed_path(directory)
    protocol, judgement = protocol_of(directory)
    match judgement:
        case Judgement.READOUT:
            found = RunPaths(directory).readouts
            if not found and _of_one_class(directory):
                from labctl.analysis.splits import OTHER_CLASSES  # with scikit-learn, which nothing else here needs

                return f"of one class cannot be judged ({OTHER_CLASSES})", f"labctl show {where}"
            judging = f"labctl evaluate {typed_path(found[0])} {where}" if found else f"labctl train {where}"
            return "is judged with a readout", judging
        case Judgement.ITSELF:
            return "is judged without a readout", f"labctl evaluate {where}"
        case Judgement.EXPERIMENT if names := _experiments_with(protocol):
            return "is judged by an experiment, which acquires all that it needs", f"labctl reproduce {' '.join(names)}"
    return "is nothing that labctl can judge", f"labctl show {where}"


def _of_one_class(directory: Path) -> bool:
    with open_run(directory) as run:
        planned = run.planned
    return np.unique(planned["label"][planned["kind"] == "image"]).size == 1


def _experiments_with(protocol: str) -> list[str]:
    from labctl.studies.paper.experiments import experiments  # which nothing else here needs

    return [one.name for one in experiments() if any(run.protocol == protocol for run in one.runs.values())]
