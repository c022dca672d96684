"""Data sets by name: cards, loading, downloading, checking.

Full sets are looked for in a folder named by the caller, in the folder named by the environment variable LABCTL_DATA,
in the user's cache, and are then downloaded. The sample `mnist-0-3` comes with the program.
"""

from collections.abc import Sequence
from pathlib import Path

from labctl.datasets import store
from labctl.datasets.cards import Card, DataFile, card, catalogue
from labctl.datasets.errors import DatasetError
from labctl.datasets.images import ImageSet, choose, read_image_set, read_npz
from labctl.datasets.store import FileCheck

__all__ = [
    "Card",
    "DataFile",
    "DatasetError",
    "FileCheck",
    "ImageSet",
    "card",
    "catalogue",
    "fetch",
    "load",
    "path",
    "verify",
]


def load(
    name: str,
    *,
    classes: Sequence[int] | None = None,
    images: int | None = None,
    seed: int | None = None,
    directory: Path | None = None,
) -> ImageSet:
    """Load a data set, or a class-balanced choice from it, in the order of the source.

    Args:
        name: Name of the data set, as on its card, or an .npz file of one's own with the arrays images and labels.
        classes: Classes to keep; None = all.
        images: How many images in all; None = every image of those classes.
        seed: Seed of the choice; None = the first images of each class.
        directory: Folder that holds the data set's folder (or is it); looked at before every other place.

    Raises:
        DatasetError: The data set is unknown, cannot be had, is damaged, or holds too few such images.
    """
    everything = read_npz(Path(name)) if name.endswith(".npz") else _read(card(name), directory)
    return everything.take(choose(everything.labels, classes=classes, images=images, seed=seed))


def _read(chosen: Card, directory: Path | None) -> ImageSet:
    try:
        folder = store.locate(chosen, directory)
    except DatasetError:
        folder = store.download(chosen)
    return read_image_set(chosen, folder)


def fetch(name: str) -> Path:
    """Download a data set into the user's cache, checking every sha256; returns its folder.

    Raises:
        DatasetError: The data set is unknown, or it cannot be downloaded.
    """
    return store.download(card(name))


def verify(name: str, directory: Path | None = None) -> tuple[FileCheck, ...]:
    """Check every file of a data set against its card.

    Raises:
        DatasetError: The data set is unknown or not found.
    """
    chosen = card(name)
    return store.check(chosen, store.locate(chosen, directory))


def path(name: str, directory: Path | None = None) -> Path:
    """The folder that holds the files of a data set.

    Raises:
        DatasetError: The data set is unknown or not found.
    """
    return store.locate(card(name), directory)
