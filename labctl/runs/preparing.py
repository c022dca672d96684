"""The first files of a run directory, written before its first shot."""

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from numpy.typing import NDArray

from labctl.runs.durable import not_written, replace_file, sync_folder
from labctl.runs.layout import FORMAT_VERSION, Manifest, RunError, RunExists, RunPaths
from labctl.runs.plan import encode_plan
from labctl.runs.shots import Durability, PlayedDrive, RunShape, ShotColumns


def prepare(
    paths: RunPaths,
    manifest: Mapping[str, Any],
    shape: RunShape,
    plan: ShotColumns,
    drive: PlayedDrive | None,
    durability: Durability,
) -> tuple[Manifest, NDArray[Any]]:
    """Make the directory, its folder of shards, plan.h5 and manifest.json; returns the manifest and planned `/shots`.

    Raises:
        RunExists: the directory holds something; nothing in it was touched.
        RunError: no room for the run, or it cannot be written.
        ValueError, TypeError: `plan` has another number of shots than `shape`, or `manifest` is not JSON.
    """
    shots = plan.table()
    if len(shots) != shape.shots:
        raise ValueError(f"the plan has {len(shots)} shots, the shape {shape.shots}")
    image = encode_plan(shots, drive)
    text = json.dumps(
        {"format_version": FORMAT_VERSION}
        | dict(manifest)
        | {
            "format_version": FORMAT_VERSION,
            "shape": shape.to_json(),
            "durability": asdict(durability),
            "plan_sha256": hashlib.sha256(image).hexdigest(),
        },
        indent=2,
        allow_nan=False,
    )
    _claim(paths, shape)
    replace_file(paths.plan, image)
    replace_file(paths.manifest, text.encode())
    return Manifest.parse(text, paths.manifest), shots


def _claim(paths: RunPaths, shape: RunShape) -> None:
    """Make the run directory and its folder of shards, if the disk has room for shards and data.h5."""
    directory = paths.directory
    try:
        needed = 2 * shape.shots * len(shape.ports) * shape.samples * shape.dtype.itemsize
        disk = next(folder for folder in (directory, *directory.absolute().parents) if folder.exists())
        if (free := shutil.disk_usage(disk).free) < needed:
            raise RunError(
                f"{directory}: the run needs {needed / 1e9:.3g} GB and the disk has {free / 1e9:.3g} GB left; "
                "make room or pick another --out"
            )
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise RunExists(f"{directory}: exists and is not empty; pick another --out, or `labctl resume {directory}`")
        paths.shards.mkdir()
        sync_folder(directory)
        sync_folder(directory.parent)
    except (FileExistsError, NotADirectoryError) as error:
        raise RunExists(f"{directory}: is a file; pick another --out") from error
    except OSError as error:
        raise not_written(directory, error) from error
