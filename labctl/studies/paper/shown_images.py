"""Which images the shots of a run were of: found by their index in the data set, never by their place."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.errors import AnalysisError
from labctl.studies.paper.contract import Material


def shown_images(material: Material, run: str, indices: ArrayLike) -> NDArray[np.bool_]:
    """The images that run `run` of `material` showed, as the mirrors were set.

    Args:
        material: What there is of one twin.
        run: Name of the run in the experiment file.
        indices: (n,) index in the data set of each image wanted; one may come more than once.

    Returns:
        (n, rows, columns), True = on.

    Raises:
        AnalysisError: The run did not show these.
        ExperimentError: The run showed no images.
    """
    shown = material.images(run)
    wanted = np.asarray(indices, np.int64)
    order = np.argsort(shown.indices)
    places = np.searchsorted(shown.indices, wanted, sorter=order).clip(max=shown.indices.size - 1)
    found = order[places]
    if strange := wanted[shown.indices[found] != wanted].tolist():
        raise AnalysisError(f"run {run} holds image {strange[0]}, which its protocol did not show: acquire it again")
    images: NDArray[np.bool_] = shown.images[found]
    return images
