"""Data sets by name: cards, loading, downloading, checking.

Full sets are looked for in a folder named by the caller, in the folder named by the environment variable LABCTL_DATA,
in the user's cache, and are then downloaded; a set that cannot be downloaded is an error that says how to get it. The
sample `mnist-0-3` comes with the program. `load` gives images, `load_sequences` numbers to be sent one after the other.
"""

from collections.abc import Sequence
from pathlib import Path

from labctl.datasets import store
from labctl.datasets.cards import Card, DataFile, card, catalogue
from labctl.datasets.images import ImageSet, choose, read_image_set, read_npz
from labctl.datasets.sequences import SequenceSet, group_splits, load_sequences
from labctl.datasets.store import FileCheck
from labctl.errors import DatasetError

__all__ = [
    "Card",
    "DataFile",
    "DatasetError",
    "FileCheck",
    "ImageSet",
    "SequenceSet",
    "card",
    "catalogue",
    "fetch",
    "group_splits",
    "load",
    "load_sequences",
    "path",
    "verify",
]


def load(
    name: str,
    *,
    classes: Sequence[int] | None = None,
    images: int | Sequence[int] | None = None,
    seed: int | None = None,
    directory: Path | None = None,
) -> ImageSet:
    """Load a data set of images, or a choice from it, in the order of the source.

    Args:
        name: Name of the data set, as on its card, or an .npz file of one's own with the arrays images and labels.
        classes: Classes to keep; None = all.
        images: How many images in all, class-balanced, or how many of each of `classes`; None = every image of those
            classes. Of picture files only these are decoded.
        seed: Seed of the choice; None = the first images of each class.
        directory: Folder that holds the data set's folder (or is it); looked at before every other place.

    Raises:
        DatasetError: The data set is unknown, cannot be had, is damaged, is none of images, or holds too few of them.
    """
    if name.endswith(".npz"):
        own = read_npz(Path(name))
        return own.take(choose(own.labels, classes=classes, images=images, seed=seed))
    chosen = card(name)
    if chosen.kind != "images":
        raise DatasetError(f"data set '{name}' holds sequences, not images: see 'labctl data list'")
    folder = store.obtained(chosen, directory)
    return read_image_set(chosen, folder, classes=classes, images=images, seed=seed)


def fetch(name: str) -> Path:
    """Download a data set into the user's cache, checking every sha256; returns its folder.

    Raises:
        DatasetError: The data set is unknown, cannot be downloaded, or must be got by hand and is not there.
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
