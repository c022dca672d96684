"""plan.h5: the columns of every planned shot and the drive, as data.h5 repeats them.

It is kept apart from the manifest because it grows with the run: a million shots have no place in JSON.
"""

import hashlib
import math
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from instruments.values import Drive
from labctl.errors import RunError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import manifest_digest
from labctl.runs.format.own_files import own_file
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS, LIBVER, attribute, check_plain, set_text, walked
from labctl.runs.format.version import FORMAT_VERSION, check_version

MOST_BYTES = 1 << 32  # unpacked: a night's shots and the longest drive have 1 GiB each


def encode_plan(shots: NDArray[Any], drive: Drive | None, manifest_sha256: str = "") -> bytes:
    """The bytes of plan.h5; the same plan gives the same bytes. `manifest_sha256` is the digest of its manifest."""
    image = BytesIO()
    with h5py.File(image, "w", libver=LIBVER) as file:
        set_text(file, "format_version", FORMAT_VERSION)
        if manifest_sha256:
            set_text(file, "manifest_sha256", manifest_sha256)
        file.create_dataset("shots", data=shots)
        write_drive(file, drive)
    return image.getvalue()


def read_plan(paths: RunPaths, sha256: str) -> tuple[NDArray[Any], Drive | None]:
    """The planned `/shots`, with the columns that they were written with, and the drive.

    `sha256` is the manifest's entry `plan_sha256`.

    Raises:
        RunError: missing, damaged, or of a later major version.
    """
    try:
        with own_file(paths.plan, MOST_BYTES) as stored:
            if hashlib.file_digest(stored, "sha256").hexdigest() != sha256:
                raise RunError(
                    f"{paths.plan}: damaged: its sha256 is not the manifest's; restore it from a copy of the run"
                )
            with walked(stored) as file:
                check_version(attribute(file, "format_version"), paths.plan)
                check_plain(file, MOST_BYTES)
                return file["shots"][:], read_drive(file)
    except HDF5_ERRORS as error:
        raise RunError(f"{paths.plan}: cannot be read ({error}); restore it from a copy of the run") from error


def names_its_manifest(paths: RunPaths, manifest: Mapping[str, Any]) -> bool:
    """Whether plan.h5 says which manifest it was written with; those of older runs do not.

    Raises:
        RunError: it is another one than `manifest`, or plan.h5 cannot be read.
    """
    try:
        with walked(paths.plan) as file:
            named = str(attribute(file, "manifest_sha256")) if "manifest_sha256" in file.attrs else ""
    except HDF5_ERRORS as error:
        raise RunError(f"{paths.plan}: cannot be read ({error}); restore it from a copy of the run") from error
    if named and named != manifest_digest(manifest):
        raise edited(paths)
    return bool(named)


def edited(paths: RunPaths) -> RunError:
    """The one line for a manifest that is not what the run was begun with."""
    return RunError(f"{paths.manifest}: edited since the run was begun: restore it from a copy of the run")


def write_drive(file: h5py.File, drive: Drive | None) -> None:
    """Add the group `/drive`: samples, the marker that goes with them, name, rate and amplitude; nothing for None."""
    if drive is not None:
        group = file.create_group("drive")
        group.create_dataset("samples", data=np.asarray(drive.samples, "<f4"))
        group.create_dataset("marker", data=drive.marker)
        group.attrs["sample_rate"] = float(drive.sample_rate)
        group.attrs["amplitude_vpp"] = float(drive.amplitude_vpp)
        set_text(group, "name", drive.name)


def read_drive(file: h5py.File) -> Drive | None:
    """The inverse of `write_drive`; of files before 1.2 without a name and with an amplitude that is not a number.

    Raises:
        ValueError, KeyError: it is damaged.
    """
    if "drive" not in file:
        return None
    group = file["drive"]
    samples = group["samples"][:]
    if samples.ndim != 1 or not samples.size or samples.dtype != np.float32 or not np.isfinite(samples).all():
        raise ValueError("its drive is not a row of samples")
    return Drive(
        name=str(attribute(group, "name")) if "name" in group.attrs else "",
        samples=samples,
        sample_rate=float(attribute(group, "sample_rate")),
        amplitude_vpp=float(attribute(group, "amplitude_vpp")) if "amplitude_vpp" in group.attrs else math.nan,
    )
