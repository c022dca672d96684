"""Going on with a run in another process: its station, from the manifest, and what must not have changed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from instruments.toml_files import describe
from instruments.values import Drive
from labctl.bench.own_files import is_own
from labctl.bench.recording.wire import Wire
from labctl.bench.station import Station, read_station
from labctl.errors import RunError, StationError
from labctl.runs.format.columns import same_shots
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import REPLAY
from labctl.runs.format.plan import edited, names_its_manifest, read_plan
from labctl.runs.format.shape import RunShape
from labctl.runs.format.version import FORMAT_VERSION
from labctl.runs.read.data_file import manifest_in
from labctl.runs.read.differences import Difference, differences

FILES = ("*.commands", "*.library")
"""Of the station: what is loaded from a place of this bench. A run never says which."""
MAY_CHANGE = ("source", "durability.*", "*.address", "laser.armed", "limits.*", *FILES)
"""Of the station: what is this bench's own business, and how much may be lost."""


class SettingsChanged(RunError):
    """The bench is not the one the run was begun on; nothing was lit.

    Attributes:
        directory: the run.
        differences: everything that differs.
    """

    def __init__(self, directory: Path, differences: tuple[Difference, ...]) -> None:
        """Of the run in `directory`."""
        self.directory, self.differences = directory, differences
        first = differences[0]
        super().__init__(
            f"{directory}: {len(differences)} settings are not those that the run was begun with, "
            f"{first.setting} first ({first.then} then, {first.now} now): set them back, or begin a new run"
        )

    def __reduce__(self) -> tuple[type[Self], tuple[Path, tuple[Difference, ...]]]:
        """It passes from a process that carries out a task to the one that tells it."""
        return type(self), (self.directory, self.differences)


def refuse_edited(paths: RunPaths, manifest: Mapping[str, Any]) -> None:
    """Compare the manifest with what plan.h5 keeps of it, or, of an older run, with the copy in data.h5.

    Raises:
        RunError: it is not the one that the run was begun with.
    """
    named = names_its_manifest(paths, manifest)
    if not named and paths.data.exists() and manifest_in(paths.data).values != manifest:
        raise edited(paths)


def refuse_mixed(directory: Path, manifest: Mapping[str, Any], wire: Wire) -> None:
    """Refuse to go on with a run of a recording where instruments would answer, and with a run of a bench in a replay.

    Raises:
        RunError: it is one.
    """
    replayed = bool(manifest.get(REPLAY))
    if replayed and wire.replay is None:
        raise RunError(
            f"{directory}: its records are those of a recording, to which a bench adds none: repeat its command under "
            f"'labctl replay', or begin a new run"
        )
    if not replayed and wire.replay is not None:
        raise RunError(
            f"{directory}: its records are those of a bench, to which a recording adds none: leave out 'labctl "
            f"replay', or begin a new run"
        )


def station_of_manifest(directory: Path, manifest: Mapping[str, Any], given: Station | None) -> Station:
    """The station the run was begun on, for what it asks; or the one that is `given` in its place.

    The first is nothing to open: whoever wrote the manifest wrote its addresses, its limits and its arm.

    Raises:
        SettingsChanged: `given` differs in more than `MAY_CHANGE`.
        RunError: the manifest does not say, or not in words that this version of labctl and its drivers know.
    """
    try:
        begun = Station.model_validate(without_files(manifest["station"]))
    except KeyError:
        raise RunError(f"{directory}: the manifest does not name the station: begin a new run") from None
    except ValidationError as error:
        raise RunError(f"{directory}: station in the manifest: {describe(error)}") from None
    except StationError as error:
        raise RunError(f"{directory}: station in the manifest: {error}") from None
    if given is None:
        return begun
    _refuse(directory, _differences(begun, given, MAY_CHANGE))
    return given


def own_station(directory: Path, begun: Station) -> Station:
    """This bench's own station for a run that was `begun` on one, where nobody names it.

    A run that was wholly simulated needs none. For any other it is the file that the run names, if it still says what
    it said then, and if a run was begun with it here: a stranger's run may come with a stranger's station.

    Raises:
        StationError: there is none, and it is to be named.
    """
    if begun.wholly_simulated:
        return begun
    file = Path(begun.source)
    if not is_own(file):
        raise StationError(
            f"{directory}: no run was begun here with the station file {begun.source!r} as it is now: name the station "
            f"of this bench by --station"
        )
    found = read_station(file)
    if changed := _differences(begun, found, FILES):
        raise StationError(
            f"{directory}: {begun.source} has changed since the run was begun ({changed[0].setting} was "
            f"{changed[0].then} and is {changed[0].now}): name the station of this bench by --station"
        )
    return found


def _differences(begun: Station, found: Station, ignored: tuple[str, ...]) -> tuple[Difference, ...]:
    then, now = (station.model_dump(mode="json") for station in (begun, found))
    return differences(then, now, of="station", ignored=ignored)


def without_files(station: object) -> object:
    """A station as a file keeps it without the files that its sections name; what is no station is left as it is."""
    if not isinstance(station, Mapping):
        return station
    return {
        role: {
            key: value for key, value in section.items() if not any(fnmatchcase(f"{role}.{key}", one) for one in FILES)
        }
        if isinstance(section, Mapping)
        else section
        for role, section in station.items()
    }


def refuse_other_plan(
    paths: RunPaths, manifest: Mapping[str, Any], shape: RunShape, shots: NDArray[Any], drive: Drive
) -> None:
    """Compare what is about to be measured with what the run was begun for.

    Raises:
        RunError: size, start, shots or drive are others, as they are where another version of labctl plans otherwise.
    """
    planned, played = read_plan(paths, manifest["plan_sha256"])
    begun = RunShape.from_json(manifest["shape"])
    same = {
        "size": replace(shape, start_s=begun.start_s) == begun,
        "start of frames": shape.start_s == begun.start_s,
        "list of shots": same_shots(planned, shots),
        "drive": played is not None
        and drive.sample_rate == played.sample_rate
        and np.array_equal(drive.samples, played.samples),
    }
    if changed := [what for what, found in same.items() if not found]:
        raise RunError(
            f"{paths.directory}: this version of labctl makes another {changed[0]} from the run's settings: resume "
            f"with the version that the manifest names, or begin a new run"
        )


def refuse_changed_instruments(
    directory: Path, manifest: Mapping[str, Any], now: Mapping[str, Any], station: Station
) -> None:
    """Compare instruments, each a map of `identity` and `settings`, with the manifest's; both taken in the same way.

    What the drivers of `station` send anew in every run is not compared, nor an instrument that the manifest does not
    have, nor, in one of an earlier format, a setting: the labctl that wrote it knew none such.

    Raises:
        SettingsChanged: another instrument, other firmware, or a setting that no run sends by itself.
    """
    then = manifest["instruments"]
    found: list[Difference] = []
    for name in (name for name in now if name in then):
        ignored = tuple(f"settings.{setting}" for setting in station.driver_of(name).sent_anew)
        found += differences(then[name], now[name], of=name, ignored=ignored)
    earlier = manifest.get("format_version") != FORMAT_VERSION
    _refuse(directory, [one for one in found if not (earlier and one.then is None)])


def _refuse(directory: Path, found: Sequence[Difference]) -> None:
    if found:
        raise SettingsChanged(directory, tuple(found))
