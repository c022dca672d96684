"""Shards of a run that is being written, once they leave memory: on disk, in the journal, in doubt or trusted."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from instruments.values import Frames
from labctl.errors import RunError
from labctl.runs.format.durable import replace_file, taken_away
from labctl.runs.format.journal import NOT_COMPARED, Entry, JournalFile
from labctl.runs.format.shard import encode
from labctl.runs.format.shards import Shards
from labctl.runs.write.recovery import discard_suspect
from labctl.runs.write.room import Room


class StoredShards:
    """Writes shards and the journal, and nothing else does; one thread at a time.

    Attributes:
        unsure: The shards that are suspect only because nobody was sure yet.
    """

    def __init__(self, shards: Shards, journal: JournalFile, room: Room, next_shard: int = 0) -> None:
        """Go on behind `shards`, which are on disk, with a shard of the number `next_shard`."""
        self.unsure: list[Entry] = []
        self._shards = shards
        self._journal = journal
        self._room = room
        self._next_shard = next_shard
        self._latest: Path | None = None  # shard that was written

    def store(
        self,
        pass_index: int,
        first: int,
        parts: Sequence[Frames],
        epochs: NDArray[np.int64],
        scales: tuple[NDArray[np.float64], NDArray[np.float64]],
        suspect: str,
    ) -> None:
        """Write a shard of a pass, fsync it, rename it, and enter it in the journal, `suspect` for a reason or ''.

        Raises:
            RunError: the disk is full or refuses, or somebody has removed what was stored before.
        """
        path = self._shards.paths.shard(self._next_shard)
        self.require_untouched()
        image = encode(self._shards.shape, pass_index, first, parts, epochs, *scales)
        self._room.before(path, len(image), self._shards)
        replace_file(path, image)
        entry = self._shards.entry(self._next_shard, pass_index, first, epochs.size, image, suspect)
        self._shards.add(entry)
        if suspect:
            self.unsure.append(entry)
        self._next_shard += 1
        self._latest = path
        self._journal.append(entry)  # at last: a signal may end this once the line is there
        self.require_untouched()

    def trust(self) -> None:
        """Enter again, as not suspect, what was stored before anybody was sure."""
        while self.unsure:
            self._journal.append(self._shards.entered_again(self.unsure[0], ""))
            del self.unsure[0]

    def doubt(self, reason: str, pass_index: int, first: int) -> None:
        """Enter again, as suspect, whatever a pass has from shot `first` on; nobody becomes sure of it any more."""
        self.unsure.clear()
        for entry in [*self._shards.entries.values()]:
            concerned = entry.pass_index == pass_index and entry.first + entry.count > first
            if concerned and entry.suspect in ("", NOT_COMPARED):
                self._journal.append(self._shards.entered_again(entry, reason))

    def discard_suspect(self) -> tuple[str, ...]:
        """Set aside what is suspect; a line for each shard."""
        lines = discard_suspect(self._shards, self._journal)
        self._latest = None
        return tuple(lines)

    def require_untouched(self) -> None:
        """Whoever removes or replaces the journal or the shards of a run that is being written ends it.

        Raises:
            RunError: somebody has. A lost journal is written anew with every shard that is stored.
        """
        if self._latest is not None and not self._latest.exists():
            if not self._shards.paths.directory.exists():
                raise taken_away(self._shards.paths.directory)
            raise RunError(
                f"{self._latest}: was removed while the run went on; what was stored before is where its folder is "
                "now: put it back, then `labctl resume` the run"
            )
        if not self._journal.untouched:
            self._journal.write_anew(self._shards.entries.values())
            raise RunError(
                f"{self._shards.paths.journal}: was removed or changed while the run went on; it is written anew, with "
                "all that was stored: find out who does that, then `labctl resume` the run"
            )

    def close(self) -> None:
        """Let go of the journal."""
        self._journal.close()
