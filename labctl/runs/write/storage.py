"""Putting shards on disk, one after the other: first the file, then the line of the journal that says it is there."""

import hashlib

from labctl.runs.format.durable import replace_file
from labctl.runs.format.journal import Entry, JournalFile
from labctl.runs.format.shards import Shard, Shards
from labctl.runs.write.room import Room


class Storing:
    """Writes closed shards, each with the next number."""

    def __init__(self, shards: Shards, journal: JournalFile, room: Room, next_shard: int) -> None:
        """Into the run of `shards`, the first one as number `next_shard`; `room` is asked before each."""
        self._shards = shards
        self._journal = journal
        self._room = room
        self._next = next_shard

    def store(self, shard: Shard) -> None:
        """Write, fsync, rename, and enter in the journal.

        Raises:
            RunError: the disk is full or refuses; `shards` are then what they were.
        """
        image = shard.encode(self._shards.shape)
        path = self._shards.paths.shard(self._next)
        self._room.before(path, len(image), self._shards)
        replace_file(path, image)
        enter(self._shards, self._journal, self._next, shard, image)
        self._next += 1


def enter(shards: Shards, journal: JournalFile, number: int, shard: Shard, image: bytes) -> None:
    """Name a shard in the journal, and add it to `shards`; its file, with the bytes `image`, is on disk.

    Raises:
        RunError: the disk is full or refuses.
    """
    count = len(shard.rows)
    entry = Entry(
        shard=number,
        pass_index=shard.pass_index,
        passes=len(shards.shape.passes),
        first=shard.first,
        shots=shards.completes(shard.pass_index, shard.first, count),
        count=count,
        sha256=hashlib.sha256(image).hexdigest(),
    )
    journal.append(entry)
    shards.add(entry)
