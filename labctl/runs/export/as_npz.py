"""NumPy's .npz: one .npy a variable, uncompressed, no pickled objects; what describes them as text arrays.

`numpy.load(file)` gives the variables by name and, as JSON, `manifest`, `units` (name of a variable to its unit),
`dimensions` (name to names of its dimensions) and `facts` (name to what else is known of it).
"""

import json
import zipfile
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import DTypeLike

from labctl.runs.export.content import Content


def write(content: Content, path: Path) -> None:
    """Write all of `content` to the file `path`.

    Raises:
        OSError: there is no room.
        RunError: the run is damaged.
    """
    described = {
        "units": {one.name: one.unit for one in content.variables if one.unit},
        "dimensions": {one.name: one.dims for one in content.variables},
        "facts": {one.name: dict(one.attributes) for one in content.variables if one.attributes},
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for variable in content.variables:
            with _entry(archive, variable.name) as file:
                _head(file, content.shape(variable), variable.dtype)
                for _, block in content.blocks(variable):
                    file.write(block.tobytes())
        for name, value in (content.attributes | {name: json.dumps(text) for name, text in described.items()}).items():
            with _entry(archive, name) as file:
                npy.write_array(file, np.array(value), allow_pickle=False)


def _entry(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    """A new .npy in the archive, of any size, without the time at which it was made."""
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)


def _head(file: IO[bytes], shape: tuple[int, ...], dtype: DTypeLike) -> None:
    described = {"descr": npy.dtype_to_descr(np.dtype(dtype)), "fortran_order": False, "shape": shape}
    npy.write_array_header_1_0(file, described)
