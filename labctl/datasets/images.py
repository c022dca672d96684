"""Image sets: labelled images, with where each one came from."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from labctl.datasets import archives, binarisation, bits, pictures, store
from labctl.datasets.cards import Card
from labctl.datasets.idx import parse_idx
from labctl.datasets.npy import parse_npy
from labctl.errors import DatasetError, one_line

NPZ = "an .npz file with the arrays images and labels"
MAX_ARRAY_BYTES = 1 << 28
"""Of one array of an .npz file, unpacked: 340 000 images of 28 x 28."""


@dataclass(frozen=True)
class ImageSet:
    """Labelled images and their origin.

    Attributes:
        name: Name of the data set.
        identity: What its images are known by, with their `indices`, whatever the set is called: `Card.identity`, or
            SHA-256 of a file of one's own.
        images: (n, rows, columns), uint8 grey levels or bool; 28 x 28 of the MNIST kind, 227 x 227 of cracks.
        labels: (n,) int64 class of each image.
        indices: (n,) int64 row of each image in the source (training rows first, then test rows; of picture files the
            place in the list of all of them, class by class and by name).
        source: Where the data comes from, with its authors and licence.
        binarisation: Rule that made the pixels binary; "none" for grey levels.
    """

    name: str
    identity: str
    images: NDArray[np.uint8] | NDArray[np.bool_]
    labels: NDArray[np.int64]
    indices: NDArray[np.int64]
    source: str
    binarisation: str

    def __len__(self) -> int:
        """Number of images."""
        return len(self.labels)

    def binarised(self, rule: str | int = bits.THRESHOLD) -> "ImageSet":
        """The same set with bright pixels True; a binary set stays as it is.

        Args:
            rule: A grey level from which on a pixel is bright, or the name of a rule of `labctl.datasets.binarisation`.

        Raises:
            DatasetError: There is no such rule.
        """
        described = binarisation.describe(rule)
        if self.images.dtype == np.bool_:
            return self
        bright = binarisation.binarise(np.asarray(self.images, np.uint8), rule)
        return replace(self, images=bright, binarisation=described)

    def take(self, positions: NDArray[np.integer]) -> "ImageSet":
        """The images at `positions` (shape (m,)), in that order."""
        return replace(
            self, images=self.images[positions], labels=self.labels[positions], indices=self.indices[positions]
        )


def read_image_set(
    card: Card,
    folder: Path,
    *,
    classes: Sequence[int] | None = None,
    images: int | Sequence[int] | None = None,
    seed: int | None = None,
) -> ImageSet:
    """Read a choice of the images of a data set whose files lie in `folder`, checking their digests.

    Args:
        card: Which data set.
        folder: Folder that holds its files.
        classes: See `choose`; so are `images` and `seed`.
        images: See there.
        seed: See there.

    Raises:
        DatasetError: A file is damaged, or there are too few such images.
    """
    if card.folders:
        with pictures.opened(folder, card.folders) as album:
            positions = choose(album.labels, classes=classes, images=images, seed=seed)
            grey = album.pictures(positions, (card.shape[1], card.shape[2]))
        return ImageSet(
            card.name, card.identity, grey, album.labels[positions], positions, card.origin, card.binarisation
        )
    everything = _everything(card, folder, tuple(store.version(folder, file) for file in card.files))
    return everything.take(choose(everything.labels, classes=classes, images=images, seed=seed))


def read_npz(path: Path) -> ImageSet:
    """Read a set of one's own: `images`, (n, rows, columns) of bool or uint8, and `labels`, (n,) integers.

    Raises:
        DatasetError: The file cannot be read, or its arrays are of another size or type.
    """
    if not path.exists():
        raise DatasetError(
            f"{path.absolute()}: no such file: repeat the command in the folder that it was named from, or put it there"
        )
    with archives.opened(path, NPZ) as archive:
        images, labels = (_array(archive, path, name) for name in ("images", "labels"))
    if images.ndim != 3 or images.dtype not in (np.bool_, np.uint8) or 0 in images.shape:
        raise DatasetError(
            f"{path}: images is {images.dtype} {images.shape}: store bool or uint8 of shape (n, rows, columns)"
        )
    if labels.shape != images.shape[:1] or not np.issubdtype(labels.dtype, np.integer):
        raise DatasetError(
            f"{path}: labels is {labels.dtype} {labels.shape}, images {images.shape}: store one integer for each image"
        )
    binarisation = "binary" if images.dtype == np.bool_ else "none"
    with path.open("rb") as file:
        identity = hashlib.file_digest(file, "sha256").hexdigest()
    indices = np.arange(len(labels))
    return ImageSet(path.stem, identity, images, labels.astype(np.int64), indices, str(path), binarisation)


def _array(archive: ZipFile, path: Path, name: str) -> NDArray[Any]:
    """One array of an .npz file."""
    try:
        member = archive.getinfo(f"{name}.npy")
        content = archives.content(archive, member.filename, MAX_ARRAY_BYTES) if archives.usual(member) else b""
    except archives.ZIP_ERRORS as error:
        raise DatasetError(f"{path}: is not {NPZ} ({one_line(error)[:200]})") from None
    if len(content) > MAX_ARRAY_BYTES:
        raise DatasetError(f"{path}: {name} unpacks to more than {MAX_ARRAY_BYTES} bytes: store fewer images")
    return parse_npy(content, f"{path}: {name}")


@lru_cache(maxsize=1)
def _everything(card: Card, folder: Path, _versions: tuple[tuple[int, int], ...]) -> ImageSet:
    """All images of a set, for reading alone: every run of an experiment takes its choice of them."""
    found = _records(card, folder) if card.bundled else _idx_files(card, folder)
    for array in (found.images, found.labels, found.indices):
        array.flags.writeable = False
    return found


def _idx_files(card: Card, folder: Path) -> ImageSet:
    contents = {file.name: parse_idx(store.read(folder, file), file.name) for file in card.files}
    images = np.concatenate([contents[file.name] for file in card.files if file.role == "images"])
    labels = np.concatenate([contents[file.name] for file in card.files if file.role == "labels"])
    indices = np.arange(len(labels))
    return ImageSet(card.name, card.identity, images, labels.astype(np.int64), indices, card.origin, card.binarisation)


def _records(card: Card, folder: Path) -> ImageSet:
    parts = [bits.unpack(store.read(folder, file), file.name) for file in card.files]
    images = np.concatenate([part[0] for part in parts])
    rows = np.concatenate([part[1] for part in parts])
    labels = np.concatenate([np.full(len(part[1]), label, np.int64) for label, part in enumerate(parts)])
    order = np.argsort(rows)
    found = images[order], labels[order], rows[order]
    return ImageSet(card.name, card.identity, *found, card.origin, card.binarisation)


def choose(
    labels: NDArray[np.integer],
    *,
    classes: Sequence[int] | None,
    images: int | Sequence[int] | None,
    seed: int | None,
) -> NDArray[np.int64]:
    """Positions of a choice with as many of each class as asked for, ascending.

    Args:
        labels: (n,) class of each candidate.
        classes: Classes to choose from; None = all.
        images: How many in all; what is left after equal shares goes to the first classes. Or how many of each class,
            in the order of `classes` (ascending where that is None). None = every candidate.
        seed: Seed of the draw; None = the first ones of each class.

    Raises:
        DatasetError: A class does not exist or holds too few images.
    """
    present = [int(label) for label in np.unique(labels)]
    wanted = present if classes is None else list(dict.fromkeys(classes))
    if unknown := [label for label in wanted if label not in present]:
        raise DatasetError(f"classes {unknown} are not in this data set: choose from {present}")
    if not wanted:
        raise DatasetError(f"no class was chosen: choose from {present}")
    if images is None:
        return np.flatnonzero(np.isin(labels, wanted))
    shares = dict(sorted(_shares(wanted, images).items()))
    members = {label: np.flatnonzero(labels == label) for label in shares}
    if lacking := [label for label, count in shares.items() if count > members[label].size]:
        label = min(lacking, key=lambda one: members[one].size)
        fewest = members[label].size
        most = f"{fewest * len(wanted)} images" if isinstance(images, int) else f"{fewest} of it"
        raise DatasetError(
            f"{shares[label]} images of class {label} were asked for, the data set has {fewest}: ask for at most "
            f"{most}, or use a larger data set"
        )
    generator = np.random.default_rng(seed)
    chosen = [
        members[label][:count] if seed is None else generator.choice(members[label], count, replace=False)
        for label, count in shares.items()
    ]
    return np.sort(np.concatenate(chosen))


def _shares(classes: list[int], images: int | Sequence[int]) -> dict[int, int]:
    """How many images of each class."""
    if isinstance(images, int):
        if images < len(classes):
            raise DatasetError(f"{images} images cannot cover {len(classes)} classes: ask for at least {len(classes)}")
        share, rest = divmod(images, len(classes))
        return {label: share + (position < rest) for position, label in enumerate(sorted(classes))}
    if len(images) != len(classes) or min(images) < 1:
        raise DatasetError(f"numbers of images {list(images)} do not fit the classes {classes}: give one for each")
    return dict(zip(classes, images, strict=True))
