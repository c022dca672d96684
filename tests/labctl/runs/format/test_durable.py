import os
from contextlib import nullcontext
from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.format import durable
from labctl.runs.format.durable import replace_file, replacement, show_file


def test_readers_see_the_old_file_or_the_new_one(tmp_path: Path) -> None:
    path = tmp_path / "file"
    replace_file(path, b"old")
    with path.open("rb") as reader:
        replace_file(path, b"new")
        assert reader.read() == b"old"
    assert path.read_bytes() == b"new"


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fsync, replace = os.fsync, os.replace
    order: list[tuple[str, int]] = []

    def noted_fsync(descriptor: int) -> None:
        order.append(("fsync", os.fstat(descriptor).st_ino))
        fsync(descriptor)

    def noted_replace(source: Path, target: Path) -> None:
        order.append(("rename", source.stat().st_ino))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", noted_fsync)
    monkeypatch.setattr(os, "replace", noted_replace)
    replace_file(tmp_path / "file", b"content")
    file, folder = (tmp_path / "file").stat().st_ino, tmp_path.stat().st_ino
    assert order == [("fsync", file), ("rename", file), ("fsync", folder)]


def test_an_error_in_between_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    replace_file(path, b"old")
    with pytest.raises(ZeroDivisionError), replacement(path):
        raise ZeroDivisionError
    with pytest.raises(RunError, match="file: cannot be written: no room"), replacement(path):
        raise OSError(28, "no room")
    assert [found.name for found in tmp_path.iterdir()] == ["file"]
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("refusals", [2, 3])
def test_a_file_that_somebody_reads_is_replaced_a_moment_later_where_the_system_refuses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refusals: int
) -> None:
    """As Windows does, for as long as it is open."""
    path, replace, refused = tmp_path / "file", os.replace, [PermissionError(13, "Access is denied")] * refusals

    def with_readers(source: Path, target: Path) -> None:
        if refused:
            raise refused.pop()
        replace(source, target)

    show_file(path, b"old")
    monkeypatch.setattr(os, "replace", with_readers)
    monkeypatch.setattr(durable, "REPLACED_AGAIN_S", (0.0, 0.0))
    with pytest.raises(PermissionError) if refusals > 2 else nullcontext():
        show_file(path, b"new")
    assert {found.name: found.read_bytes() for found in tmp_path.iterdir()} == {
        "file": b"old" if refusals > 2 else b"new"
    }


def test_what_is_shown_waits_for_no_disk_and_goes_nowhere_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, other = tmp_path / "file", tmp_path / "other"
    other.write_bytes(b"theirs")
    path.with_name(f"file.{os.getpid()}.tmp").symlink_to(other)
    monkeypatch.delattr(os, "fsync")
    show_file(path, b"old")
    with path.open("rb") as reader:
        show_file(path, b"new")
        assert reader.read() == b"old"
    assert {found.name: found.read_bytes() for found in tmp_path.iterdir()} == {"file": b"new", "other": b"theirs"}
