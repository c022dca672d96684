"""Image sets: labelled 28 x 28 images, with where each one came from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from labctl.datasets import bits, store
from labctl.datasets.cards import Card
from labctl.datasets.errors import DatasetError
from labctl.datasets.idx import parse_idx


@dataclass(frozen=True)
class ImageSet:
    """Labelled images and their origin.

    Attributes:
        name: Name of the data set.
        images: (n, 28, 28), uint8 grey levels or bool.
        labels: (n,) int64 class of each image.
        indices: (n,) int64 row of each image in the source (training rows first, then test rows).
        source: Where the data comes from, with its authors and licence.
        binarisation: Rule that made the pixels binary; "none" for grey levels.
    """

    name: str
    images: NDArray[np.uint8] | NDArray[np.bool_]
    labels: NDArray[np.int64]
    indices: NDArray[np.int64]
    source: str
    binarisation: str

    def __len__(self) -> int:
        """Number of images."""
        return len(self.labels)

    def binarised(self, threshold: int = bits.THRESHOLD) -> "ImageSet":
        """The same set with pixels True where the grey level is at least `threshold`; a binary set stays as it is."""
        if self.images.dtype == np.bool_:
            return self
        return replace(self, images=self.images >= threshold, binarisation=f"pixel >= {threshold}")

    def take(self, positions: NDArray[np.integer]) -> "ImageSet":
        """The images at `positions` (shape (m,)), in that order."""
        return replace(
            self, images=self.images[positions], labels=self.labels[positions], indices=self.indices[positions]
        )


def read_image_set(card: Card, folder: Path) -> ImageSet:
    """Read all images of a data set whose files lie in `folder`, checking their digests.

    Raises:
        DatasetError: A file is damaged.
    """
    images: NDArray[np.uint8] | NDArray[np.bool_]
    if card.bundled:
        images, labels, indices = _records(card, folder)
    else:
        images, labels, indices = _idx_files(card, folder)
    source = f"{card.title}, {card.attribution}, {card.licence}, {card.source}"
    return ImageSet(card.name, images, labels, indices, source, card.binarisation)


def read_npz(path: Path) -> ImageSet:
    """Read a set of one's own: `images`, (n, rows, columns) of bool or uint8, and `labels`, (n,) integers.

    Raises:
        DatasetError: The file cannot be read, or its arrays are of another size or type.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            images, labels = file["images"], file["labels"]
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile) as error:
        raise DatasetError(f"{path}: is not an .npz file with the arrays images and labels ({error})") from None
    if images.ndim != 3 or images.dtype not in (np.bool_, np.uint8) or 0 in images.shape:
        raise DatasetError(
            f"{path}: images is {images.dtype} {images.shape}: store bool or uint8 of shape (n, rows, columns)"
        )
    if labels.shape != images.shape[:1] or not np.issubdtype(labels.dtype, np.integer):
        raise DatasetError(
            f"{path}: labels is {labels.dtype} {labels.shape}, images {images.shape}: store one integer for each image"
        )
    binarisation = "binary" if images.dtype == np.bool_ else "none"
    return ImageSet(path.stem, images, labels.astype(np.int64), np.arange(len(labels)), str(path), binarisation)


def _idx_files(card: Card, folder: Path) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
    contents = {file.name: parse_idx(store.read(folder, file), file.name) for file in card.files}
    images = np.concatenate([contents[file.name] for file in card.files if file.role == "images"])
    labels = np.concatenate([contents[file.name] for file in card.files if file.role == "labels"])
    return images, labels.astype(np.int64), np.arange(len(labels))


def _records(card: Card, folder: Path) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    parts = [bits.unpack(store.read(folder, file), file.name) for file in card.files]
    images = np.concatenate([part[0] for part in parts])
    rows = np.concatenate([part[1] for part in parts])
    labels = np.concatenate([np.full(len(part[1]), label, np.int64) for label, part in enumerate(parts)])
    order = np.argsort(rows)
    return images[order], labels[order], rows[order]


def choose(
    labels: NDArray[np.integer], *, classes: Sequence[int] | None, images: int | None, seed: int | None
) -> NDArray[np.int64]:
    """Positions of a class-balanced choice, ascending.

    Args:
        labels: (n,) class of each candidate.
        classes: Classes to choose from; None = all.
        images: How many in all; None = every candidate. What is left after equal shares goes to the first classes.
        seed: Seed of the draw; None = the first ones of each class.

    Raises:
        DatasetError: A class does not exist or holds too few images.
    """
    present = [int(label) for label in np.unique(labels)]
    wanted = present if classes is None else sorted(set(classes))
    if unknown := [label for label in wanted if label not in present]:
        raise DatasetError(f"classes {unknown} are not in this data set: choose from {present}")
    if not wanted:
        raise DatasetError(f"no class was chosen: choose from {present}")
    if images is None:
        return np.flatnonzero(np.isin(labels, wanted))
    if images < len(wanted):
        raise DatasetError(f"{images} images cannot cover {len(wanted)} classes: ask for at least {len(wanted)}")
    generator = np.random.default_rng(seed)
    share, rest = divmod(images, len(wanted))
    chosen = []
    for position, label in enumerate(wanted):
        count = share + (position < rest)
        members = np.flatnonzero(labels == label)
        if count > len(members):
            raise DatasetError(
                f"{count} images of class {label} were asked for, the data set has {len(members)}: ask for at most "
                f"{len(members) * len(wanted)} images, or use a larger data set"
            )
        chosen.append(members[:count] if seed is None else generator.choice(members, count, replace=False))
    return np.sort(np.concatenate(chosen))
