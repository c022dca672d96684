"""The first files of a run directory, written before its first shot."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from numpy.typing import NDArray

from instruments.values import Drive
from labctl.errors import RunExists
from labctl.runs.format.durable import make_folder, not_made, replace_file, sync_folder
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
    seconds_a_shot: float,
) -> Manifest:
    """Make the directory, its folder of shards, plan.h5, an empty journal and, last, manifest.json.

    `plan` is the planned `/shots`.

    Raises:
        RunExists: the directory holds something; nothing in it was touched.
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
    require(paths.directory, needed(shape, drive, durability, seconds_a_shot))
    _claim(paths)
    replace_file(paths.plan, image, not_made)
    # Before the manifest: what has that is a run, and one without journal is damaged.
    replace_file(paths.journal, b"", not_made)
    replace_file(paths.manifest, prepared.encode(), not_made)
    return prepared


def _claim(paths: RunPaths) -> None:
    """Make the run directory and its folder of shards."""
    directory = paths.directory
    try:
        make_folder(directory)
        if any(directory.iterdir()):
            raise RunExists(f"{directory}: exists and is not empty; pick another --out, or `labctl resume {directory}`")
        paths.shards.mkdir()
        sync_folder(directory)
    except (FileExistsError, NotADirectoryError) as error:
        raise RunExists(f"{directory}: is a file; pick another --out") from error
    except OSError as error:
        raise not_made(directory, error) from error
