"""A live view left alone: who looks keeps it, and its own clock alone counts."""

from pathlib import Path

from labctl.engine.audience import Audience
from labctl.runs.live.sight import look_at
from tests.labctl.engine.conftest import Clock


def test_who_never_came_has_left_after_the_time(tmp_path: Path, clock: Clock) -> None:
    audience = Audience(tmp_path, 600.0, clock)
    clock.now = 599.0
    assert not audience.has_left
    clock.now = 600.0
    assert audience.has_left


def test_each_look_gives_it_the_whole_time_again(tmp_path: Path, clock: Clock) -> None:
    audience = Audience(tmp_path, 600.0, clock)
    for _ in range(5):
        look_at(tmp_path)
        clock.now += 599.0
        assert not audience.has_left
    clock.now += 600.0
    assert audience.has_left


def test_a_view_of_a_terminal_has_no_such_end(tmp_path: Path, clock: Clock) -> None:
    audience = Audience(tmp_path, None, clock)
    clock.now = 1e9
    assert not audience.has_left


def test_what_is_no_file_keeps_nothing(tmp_path: Path, clock: Clock) -> None:
    audience = Audience(tmp_path, 600.0, clock)
    (tmp_path / "looked").symlink_to(tmp_path / "elsewhere")
    look_at(tmp_path)
    assert not (tmp_path / "elsewhere").exists()
    assert not audience.has_left
    (tmp_path / "looked").unlink()
    clock.now = 600.0
    assert not audience.has_left, "it changed"
    clock.now = 1200.0
    assert audience.has_left
