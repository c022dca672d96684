"""What a protocol shows or plays: loaded from its data set, chosen by its seed."""

from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from labctl import datasets
from labctl.datasets.sequences import load_sequences
from protocols.base import Images, Inputs, Measurement, ProtocolError, Sequences


@runtime_checkable
class ShowsImages(Protocol):
    """Settings of a protocol that shows images."""

    @property
    def seed(self) -> int: ...  # noqa: D102
    @property
    def dataset(self) -> str: ...  # noqa: D102
    @property
    def classes(self) -> tuple[int, ...] | None: ...  # noqa: D102
    @property
    def images(self) -> int | tuple[int, ...]: ...  # noqa: D102
    @property
    def binarisation(self) -> str: ...  # noqa: D102


@runtime_checkable
class PlaysSequences(Protocol):
    """Settings of a protocol that plays sequences."""

    @property
    def seed(self) -> int: ...  # noqa: D102
    @property
    def dataset(self) -> str: ...  # noqa: D102
    @property
    def classes(self) -> tuple[int, ...] | None: ...  # noqa: D102
    @property
    def symbols(self) -> int | None: ...  # noqa: D102


def inputs_for(protocol: Measurement[Any], data: Path | None = None) -> Inputs:
    """What `protocol` asks for.

    Raises:
        DatasetError: the data set is missing, damaged or too small.
        ProtocolError: the protocol names no data set that labctl could load.
    """
    if isinstance(protocol, ShowsImages):
        return images_for(protocol, data)
    if isinstance(protocol, PlaysSequences):
        return sequences_for(protocol, data)
    raise ProtocolError(
        f"protocol {protocol.name!r} names neither images nor sequences: it needs the settings of one of them"
    )


def images_for(protocol: ShowsImages, data: Path | None = None) -> Images:
    """The images that `protocol` shows.

    Raises:
        DatasetError: the data set is missing, damaged or too small.
    """
    loaded = datasets.load(
        protocol.dataset, classes=protocol.classes, images=protocol.images, seed=protocol.seed, directory=data
    ).binarised(protocol.binarisation)
    return Images(loaded.images.astype(np.bool_), loaded.labels, loaded.indices)


def sequences_for(protocol: PlaysSequences, data: Path | None = None) -> Sequences:
    """Whole sequences, or a stretch of each at a place drawn by the seed, which then is what it is known by.

    Raises:
        DatasetError: the data set is missing or damaged.
        ProtocolError: the sequences are shorter than the stretches asked for.
    """
    loaded = load_sequences(protocol.dataset, classes=protocol.classes, directory=data)
    length = loaded.sequences.shape[1]
    if protocol.symbols is None or protocol.symbols == length:
        return Sequences(loaded.sequences, loaded.labels, loaded.groups, loaded.indices)
    if protocol.symbols > length:
        raise ProtocolError(
            f"symbols = {protocol.symbols}: the sequences of {protocol.dataset!r} have {length}: ask for fewer"
        )
    starts = np.random.default_rng((protocol.seed, 4)).integers(0, length - protocol.symbols, len(loaded))
    columns = starts[:, np.newaxis] + np.arange(protocol.symbols)
    stretches = np.take_along_axis(loaded.sequences, columns, axis=1)
    return Sequences(stretches, loaded.labels, loaded.groups, loaded.indices * length + starts)
