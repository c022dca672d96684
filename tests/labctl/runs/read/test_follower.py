"""A run while it grows: what was measured last, and what is there on the first ports."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labctl.errors import RunError
from labctl.runs.format.journal import JournalFile
from labctl.runs.read.follower import Follower
from labctl.runs.read.run import open_run
from labctl.runs.write.writer import RunWriter


def test_it_sees_what_was_added_and_nothing_twice(
    tmp_path: Path, small: Any, begin: Callable[..., RunWriter], measure: Callable[..., Any]
) -> None:
    with begin(tmp_path / "run") as writer:
        following = Follower(tmp_path / "run")
        assert not following.look()
        assert following.latest() == []
        writer.scales(0, 1e-3, 0.05)
        for shot in range(3):  # one shard, of a reference, a dark frame and an image
            writer.append(0, shot, measure(small, 0, shot), 1)
        assert following.look()
        assert not following.look()
        assert following.done == (3, 0)
        (latest,) = following.latest()
        assert (latest.shot, latest.kind, latest.ports) == (2, "image", (2, 3, 4, 5))
        expected = 1e-3 * measure(small, 0, 2).codes + 0.05
        assert np.allclose(latest.volts, expected)
        assert np.allclose(latest.ends, [0.05 - 0.128, 0.05 + 0.127])
        assert following.measured(4, 100) is None


def test_the_first_ports_stand_for_all_until_there_are_enough(cut: Path) -> None:
    following = Follower(cut)
    while following.look():
        pass
    assert following.done == (7, 3)
    first = following.measured(4, 100)
    assert first is not None
    assert first.ports == (2, 3, 4, 5)
    assert len(first.frames) == 7
    whole = following.measured(3, 100)
    assert whole is not None
    with open_run(cut) as stored:
        assert np.array_equal(whole.frames[:], stored.frames[:])
        assert np.array_equal(whole.shots["label"], stored.shots["label"])
    assert len(following.measured(3, 3).frames) == 3  # type: ignore[union-attr]


def test_what_is_seen_on_all_ports_is_one_shot(cut: Path) -> None:
    following = Follower(cut)
    while following.look():
        pass
    seen = following.latest()
    assert len({one.shot for one in seen}) == 1
    assert [one.ports for one in seen] == [(2, 3, 4, 5), (6,)]
    assert [following.has(0, shot) for shot in (6, 7)] == [True, False]
    (first,) = following.shot(6)
    assert (first.shot, first.ports) == (6, (2, 3, 4, 5))


def test_damage_is_said_and_a_torn_line_waits(cut: Path) -> None:
    following = Follower(cut)
    journal = cut / "journal.jsonl"
    lines = journal.read_bytes()
    journal.write_bytes(lines + b'nonsense\n{"shard": 9')
    while following.look():
        pass
    assert following.entries == lines.count(b"\n")
    for shard in (cut / "shards").iterdir():
        shard.write_bytes(b"")
    with pytest.raises(RunError, match=r"shards/00000\d\.h5: damaged"):
        following.latest()
    JournalFile(journal).close()  # which mends it, as a resumed run does
    assert not following.look()
