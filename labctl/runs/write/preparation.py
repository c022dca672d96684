"""The first files of a run directory, written before its first shot."""

import hashlib
import json
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from instruments.values import Drive
from labctl.errors import RunExists
from labctl.runs.format.durable import make_folder, not_made, replace_file, sync_folder
from labctl.runs.format.journal import JournalFile
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest, manifest_digest
from labctl.runs.format.plan import encode_plan
from labctl.runs.format.shape import RunShape
from labctl.runs.format.version import FORMAT_VERSION
from labctl.runs.write.durability import Durability
from labctl.runs.write.room import needed, require


def prepare(
    paths: RunPaths,
    manifest: Mapping[str, Any],
    shape: RunShape,
    plan: NDArray[Any],
    drive: Drive | None,
    durability: Durability,
    in_a_shard: float,
) -> tuple[Manifest, JournalFile]:
    """Make the directory, its folder of shards, an empty journal, plan.h5 and, last, manifest.json.

    `plan` is the planned `/shots`. The journal is held from then on. What a process has left there that was killed
    meanwhile is used.

    Raises:
        RunExists: the directory holds something else; nothing in it was touched.
        RunInUse: another process is beginning a run there.
        RunError: no room for the run, or it cannot be written.
        ValueError, TypeError: `plan` has another number of shots than `shape`, or `manifest` is not JSON.
    """
    if len(plan) != shape.shots:
        raise ValueError(f"the plan has {len(plan)} shots, the shape {shape.shots}")
    asked = (
        {"format_version": FORMAT_VERSION}
        | dict(manifest)
        | {"format_version": FORMAT_VERSION, "shape": shape.to_json(), "durability": asdict(durability)}
    )
    read_back = json.loads(json.dumps(asked, allow_nan=False))
    image = encode_plan(plan, drive, manifest_digest(read_back))
    prepared = Manifest(read_back | {"plan_sha256": hashlib.sha256(image).hexdigest()})
    require(paths.directory, needed(shape, drive, in_a_shard))
    _claim(paths)
    # The journal before the manifest: what has that is a run, and one without journal is damaged.
    with ExitStack() as stack:
        journal = stack.enter_context(JournalFile(paths.journal))
        _refuse_taken(paths)  # another process may have begun a run here before this one had the journal
        replace_file(paths.plan, image, not_made)
        replace_file(paths.manifest, prepared.encode(), not_made)
        stack.pop_all()
    return prepared, journal


def _claim(paths: RunPaths) -> None:
    """Make the run directory, its folder of shards and its journal, where they are not there yet."""
    directory = paths.directory
    try:
        make_folder(directory)
        _refuse_taken(paths)
        paths.shards.mkdir(exist_ok=True)
        paths.journal.touch()
        sync_folder(directory)
    except (FileExistsError, NotADirectoryError) as error:
        raise RunExists(f"{directory}: is a file; pick another --out") from error
    except OSError as error:
        raise not_made(directory, error) from error


def _refuse_taken(paths: RunPaths) -> None:
    directory = paths.directory
    if not all(_is_left(path, paths) for path in directory.iterdir()):
        raise RunExists(f"{directory}: exists and is not empty; pick another --out, or `labctl resume {directory}`")


def _is_left(path: Path, paths: RunPaths) -> bool:
    """Whether a process may have left it that was killed before the manifest was there: nothing was measured then."""
    if path == paths.shards:
        return path.is_dir() and not path.is_symlink() and not any(path.iterdir())
    if path == paths.journal and path.stat(follow_symlinks=False).st_size:
        return False
    return path.is_file() and not path.is_symlink() and (path in (paths.plan, paths.journal) or path.suffix == ".tmp")
