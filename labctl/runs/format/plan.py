"""plan.h5: the columns of every planned shot and the drive, as data.h5 repeats them.

It is kept apart from the manifest because it grows with the run: a million shots have no place in JSON.
"""

import hashlib
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from labctl.errors import RunError
from labctl.runs.format.layout import FORMAT_VERSION, HDF5_ERRORS, LIBVER, RunPaths, check_version
from labctl.runs.format.plain_hdf5 import check_plain, opened_image
from labctl.runs.format.shots import PlayedDrive

MOST_BYTES = 1 << 32  # unpacked: a night's shots and the longest drive have 1 GiB each


def encode_plan(shots: NDArray[Any], drive: PlayedDrive | None) -> bytes:
    """The bytes of plan.h5; the same plan gives the same bytes."""
    with h5py.File("plan", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.create_dataset("shots", data=shots)
        write_drive(file, drive)
        file.flush()
        image: bytes = file.id.get_file_image()
    return image


def read_plan(paths: RunPaths, sha256: str) -> tuple[NDArray[Any], PlayedDrive | None]:
    """The planned `/shots` and the drive. `sha256` is the manifest's entry `plan_sha256`.

    Raises:
        RunError: missing, damaged, or of a later major version.
    """
    try:
        image = paths.plan.read_bytes()
        if hashlib.sha256(image).hexdigest() != sha256:
            raise RunError(
                f"{paths.plan}: damaged: its sha256 is not the manifest's; restore it from a copy of the run"
            )
        with opened_image(image) as file:
            check_version(file.attrs["format_version"], paths.plan)
            check_plain(file, MOST_BYTES)
            return file["shots"][:], read_drive(file)
    except HDF5_ERRORS as error:
        raise RunError(f"{paths.plan}: cannot be read ({error}); restore it from a copy of the run") from error


def write_drive(file: h5py.File, drive: PlayedDrive | None) -> None:
    """Add the group `/drive`: samples, marker, and the attribute sample_rate in S/s. Nothing for None."""
    if drive is not None:
        group = file.create_group("drive")
        group.create_dataset("samples", data=np.asarray(drive.samples, "<f4"))
        group.create_dataset("marker", data=np.asarray(drive.marker, np.bool_))
        group.attrs["sample_rate"] = float(drive.sample_rate)


def read_drive(file: h5py.File) -> PlayedDrive | None:
    """The inverse of `write_drive`."""
    if "drive" not in file:
        return None
    group = file["drive"]
    return PlayedDrive(group["samples"][:], group["marker"][:], float(group.attrs["sample_rate"]))
