"""What a protocol shows or plays: loaded from its data set, chosen by its seed."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from labctl import datasets
from labctl.datasets.sequences import load_sequences
from protocols.base import Images, Inputs, Measurement, ProtocolError, Sequences
from protocols.settings import EVERY_IMAGE


def inputs_for(protocol: Measurement[Any], data: Path | None = None) -> Inputs:
    """What `protocol` takes; `data` is a folder of data sets that is looked at first.

    Raises:
        DatasetError: the data set is missing, damaged or too small.
        ProtocolError: the protocol lacks a setting that says what it takes, or asks for more than there is.
    """
    return LOADERS[protocol.takes](protocol, data)


def images_for(protocol: Measurement[Images], data: Path | None = None) -> Images:
    """The images that `protocol` shows.

    Raises:
        DatasetError, ProtocolError: as in `inputs_for`.
    """
    name, classes, count, rule = _settings(protocol, "dataset", "classes", "images", "binarisation")
    images = None if count == EVERY_IMAGE else count
    loaded = datasets.load(name, classes=classes, images=images, seed=protocol.seeds.images, directory=data).binarised(
        rule
    )
    return Images(loaded.images.astype(np.bool_, copy=False), loaded.labels, loaded.indices, loaded.identity)


def sequences_for(protocol: Measurement[Sequences], data: Path | None = None) -> Sequences:
    """Whole sequences, or a stretch of each at a place drawn by the seed, which then is what it is known by.

    Raises:
        DatasetError, ProtocolError: as in `inputs_for`; the sequences are shorter than the stretches asked for.
    """
    name, classes, symbols = _settings(protocol, "dataset", "classes", "symbols")
    loaded = load_sequences(name, classes=classes, directory=data)
    length = loaded.sequences.shape[1]
    if symbols is None or symbols == length:
        return Sequences(loaded.sequences, loaded.labels, loaded.groups, loaded.indices, name)
    if symbols > length:
        raise ProtocolError(f"symbols = {symbols}: the sequences of {name!r} have {length}: ask for fewer")
    starts = np.random.default_rng((protocol.seeds.images, 4)).integers(0, length - symbols, len(loaded))
    columns = starts[:, np.newaxis] + np.arange(symbols)
    stretches = np.take_along_axis(loaded.sequences, columns, axis=1)
    return Sequences(stretches, loaded.labels, loaded.groups, loaded.indices * length + starts, name)


LOADERS: Mapping[type[Images | Sequences], Callable[[Any, Path | None], Inputs]] = {
    Images: images_for,
    Sequences: sequences_for,
}
"""What a protocol can take, and what loads it."""


def _settings(protocol: Measurement[Any], *names: str) -> Iterator[Any]:
    """The values of settings that say what `protocol` takes."""
    for name in names:
        if not hasattr(protocol, name):
            raise ProtocolError(
                f"protocol {protocol.name!r} takes {protocol.takes.__name__.lower()}, but has no setting {name!r}: "
                f"give it {', '.join(names)}"
            )
        yield getattr(protocol, name)
