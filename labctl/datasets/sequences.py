"""Sequence sets: numbers to be sent one after the other, with the class, speaker and origin of each sequence."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.datasets import store
from labctl.datasets.cards import Card, card
from labctl.datasets.series import parse_series
from labctl.datasets.vowels import parse_vowels
from labctl.errors import DatasetError

NOTHING = -1
"""Label of a sequence without a class, group of a sequence without a speaker."""


@dataclass(frozen=True)
class SequenceSet:
    """Sequences of numbers as they are in the source: scaling to a drive is left to whoever sends them.

    Attributes:
        name: Name of the data set.
        sequences: (n, symbols) float64.
        labels: (n,) int64 class of each sequence; -1 = none.
        groups: (n,) int64 speaker of each sequence; -1 = none.
        indices: (n,) int64 row of each sequence in the source.
        training: (n,) bool, True in the training part of the source; all True where the source has no parts.
        source: Where the data comes from, with its authors and licence.
    """

    name: str
    sequences: NDArray[np.float64]
    labels: NDArray[np.int64]
    groups: NDArray[np.int64]
    indices: NDArray[np.int64]
    training: NDArray[np.bool_]
    source: str

    def __len__(self) -> int:
        """Number of sequences."""
        return len(self.labels)

    def take(self, positions: NDArray[np.integer]) -> "SequenceSet":
        """The sequences at `positions` (shape (m,)), in that order."""
        return replace(
            self,
            sequences=self.sequences[positions],
            labels=self.labels[positions],
            groups=self.groups[positions],
            indices=self.indices[positions],
            training=self.training[positions],
        )


def load_sequences(name: str, *, classes: Sequence[int] | None = None, directory: Path | None = None) -> SequenceSet:
    """Load a data set of sequences in the order of the source.

    Args:
        name: Name of the data set, as on its card.
        classes: Classes to keep; None = all.
        directory: Folder that holds the data set's folder (or is it); looked at before every other place.

    Raises:
        DatasetError: The data set is unknown, cannot be had, is damaged, is none of sequences, or lacks a class.
    """
    chosen = card(name)
    if chosen.kind != "sequences":
        raise DatasetError(f"data set '{name}' holds images, not sequences: see 'labctl data list'")
    everything = read_sequence_set(chosen, store.obtained(chosen, directory))
    if classes is None:
        return everything
    present = np.unique(everything.labels).tolist()
    if unknown := sorted(set(classes) - set(present)):
        raise DatasetError(f"classes {unknown} are not in '{name}': choose from {present}")
    return everything.take(np.flatnonzero(np.isin(everything.labels, list(classes))))


def read_sequence_set(card: Card, folder: Path) -> SequenceSet:
    """Read all sequences of a data set whose file lies in `folder`, checking its digest.

    Raises:
        DatasetError: The file is damaged.
    """
    (file,) = card.files
    content = store.read(folder, file)
    if file.role == "series":
        values = parse_series(content, file.name)
        nothing = np.array([NOTHING])
        return SequenceSet(card.name, values[None], nothing, nothing, np.array([0]), np.array([True]), card.origin)
    rows = parse_vowels(content, file.name)
    places = np.arange(len(rows.labels))
    return SequenceSet(card.name, rows.features, rows.labels, rows.speakers, places, rows.training, card.origin)


def group_splits(
    groups: NDArray[np.integer], *, splits: int = 10, test_groups: int, seed: int
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Random splits by speaker: nobody who was trained on is tested.

    Args:
        groups: (n,) speaker of each sequence.
        splits: How many splits.
        test_groups: How many speakers are tested.
        seed: Seed of the draw.

    Yields:
        Positions of the training sequences and of the test sequences, both ascending.

    Raises:
        DatasetError: There are not that many speakers.
    """
    speakers = np.unique(groups)
    if not 0 < test_groups < len(speakers):
        raise DatasetError(f"{test_groups} of {len(speakers)} speakers cannot be tested: leave some on both sides")
    generator = np.random.default_rng(seed)
    for _ in range(splits):
        tested = np.isin(groups, generator.choice(speakers, test_groups, replace=False))
        yield np.flatnonzero(~tested), np.flatnonzero(tested)
