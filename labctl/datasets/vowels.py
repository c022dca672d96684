"""The Deterding vowels: one row of text for every window of an utterance, six of each.

A row is the part (0 training, 1 test), speaker, sex (0 male, 1 female), ten log area ratios of the vocal tract and the
vowel's class, with commas or blanks between them. Source: D. H. Deterding, thesis, Cambridge, 1989; the file
vowel-context.data of A. J. Robinson.
"""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.errors import DatasetError

FEATURES = 10
SPEAKERS, CLASSES = 15, 11
MAX_ROWS = 10_000

_NUMBER = r"([-+]?[0-9]{1,9}(?:\.[0-9]{0,9})?)"
_ROW = re.compile(
    r"[ \t]*([01])"
    + r"(?:[ \t]*,[ \t]*|[ \t]+)".join(["", r"([0-9]{1,3})", "([01])"] + [_NUMBER] * FEATURES + [r"([0-9]{1,3})"])
    + r"[ \t]*",
    re.ASCII,
)


@dataclass(frozen=True)
class Windows:
    """The rows of the table.

    Attributes:
        features: (n, 10) float64 log area ratios.
        labels: (n,) int64 class of the vowel, 0..10: hid, hId, hEd, hAd, hYd, had, hOd, hod, hUd, hud, hed.
        speakers: (n,) int64, 0..14.
        training: (n,) bool, True in the training part of the source.
    """

    features: NDArray[np.float64]
    labels: NDArray[np.int64]
    speakers: NDArray[np.int64]
    training: NDArray[np.bool_]


def parse_vowels(content: bytes, name: str) -> Windows:
    """The windows of speech in the text of vowel-context.data.

    Args:
        content: The whole file.
        name: What to call it in an error.

    Raises:
        DatasetError: It is not such a table.
    """
    rows = []
    for number, line in enumerate(content.decode("latin-1").splitlines(), 1):
        if not line.strip():
            continue
        row = _ROW.fullmatch(line)
        if row is None:
            raise DatasetError(
                f"{name}, line {number}: not a vowel (0 or 1, speaker, sex, {FEATURES} numbers, class): fetch it again"
            )
        rows.append(row.groups())
        if len(rows) > MAX_ROWS:
            raise DatasetError(f"{name}: more than {MAX_ROWS} rows: it is not the vowel table")
    if not rows:
        raise DatasetError(f"{name}: holds no rows: fetch it again")
    table = np.array(rows, np.float64)
    speakers, labels = table[:, 1].astype(np.int64), table[:, -1].astype(np.int64)
    if speakers.max() >= SPEAKERS or labels.max() >= CLASSES:
        raise DatasetError(f"{name}: speakers are 0..{SPEAKERS - 1} and classes 0..{CLASSES - 1}: fetch it again")
    return Windows(table[:, 3:-1], labels, speakers, table[:, 0] == 0)
