"""A run that was measured in a folder of whoever measured it, put into its place whole."""

import os
import shutil
from pathlib import Path
from uuid import uuid4

from labctl.runs.format.durable import not_made, sync_folder
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.store import StorePath, alone


def put_whole(run: Path, place: Path) -> bool:
    """Copy a run to `place`, where it is found whole or not at all; False: a run is there already, and stays.

    A folder gets its name when everything is in it. In a store the manifest comes last: what has none is no run.

    Raises:
        RunError, Unreachable: the place cannot be written.
    """
    there = alone(place)
    if RunPaths(there).manifest.exists():
        return False
    if isinstance(there, StorePath):
        there.put(run, RunPaths(run).manifest.name)
        return True
    # One folder down: whoever is killed meanwhile leaves nothing that looks like a run beside the others.
    beside = place.with_name(f"{place.name}.{uuid4().hex[:8]}.part") / place.name
    try:
        shutil.copytree(run, beside, copy_function=_copy)
        for folder in (path for path in beside.rglob("*") if path.is_dir()):
            sync_folder(folder)
        sync_folder(beside)
        beside.rename(place)
        sync_folder(place.parent)
    except OSError as error:
        if not RunPaths(place).manifest.exists():  # else somebody was quicker
            raise not_made(place, error) from error
        return False
    finally:
        shutil.rmtree(beside.parent, ignore_errors=True)
    return True


def _copy(source: str, target: str) -> None:
    shutil.copyfile(source, target)
    with open(target, "r+b") as file:
        os.fsync(file.fileno())
