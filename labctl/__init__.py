"""labctl: runs a photonic machine-vision bench, real or simulated, from images in to accuracy out."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import xarray


def open_run(path: "Path | str") -> "xarray.Dataset":
    """A run, finished or still going on, as an xarray Dataset that reads nothing before it is looked at.

    Dimensions are shot, port, time (s after the trigger), pass and drive_sample. `frames` are digitiser codes and
    `volts` the signal in V, both (shot, port, time); the coordinates say what shots and ports are, and the
    manifest in the attribute `manifest`, as JSON. A run that is going on is shown as it is now. Close the dataset, or
    use it as a context manager. Needs the extra `data`.

    Args:
        path: A run directory, or a data.h5 by itself.

    Raises:
        labctl.runs.RunError: Not a run, or damaged, or xarray is not installed; says what to do.

    Example:
        >>> from labctl import open_run
        >>> with open_run("runs/mine") as run:
        ...     run.volts.sel(port=3, time=slice(0, 0.4e-9)).shape
        (220, 11)
    """
    from labctl.errors import RunError

    try:
        from labctl.runs.read.as_xarray import dataset_of
    except ModuleNotFoundError as error:
        if error.name != "xarray":
            raise
        raise RunError(
            f'{path}: needs xarray to be opened: pip install "photonic-labctl[data]", or read its data.h5 with h5py'
        ) from None
    return dataset_of(path)
