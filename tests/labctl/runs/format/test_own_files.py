import os
import socket
import stat
from collections.abc import Callable
from io import FileIO
from pathlib import Path

import h5py
import pytest

from labctl.errors import RunError
from labctl.runs.format.own_files import opened, own_file, place_of, read_own, require_own_files


def bind(path: Path) -> None:
    os.chdir(path.parent)  # a socket's whole path has no more than 108 letters
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(path.name)


STRANGE: dict[str, Callable[[Path], object]] = {
    "a link to another place": lambda path: path.symlink_to(__file__),
    "a pipe": lambda path: os.mkfifo(path),
    "a socket": bind,
    "a device": lambda path: os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 5)),
}


@pytest.mark.skipif(os.name == "nt", reason="needs links and pipes")
@pytest.mark.parametrize("what", STRANGE)
def test_what_is_no_file_is_neither_read_nor_written(
    tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "shards" / "file"
    path.parent.mkdir()
    try:
        STRANGE[what](path)
    except PermissionError:
        pytest.skip("only the administrator makes devices")
    with pytest.raises(OSError, match=f"is {what}"):
        own_file(path)
    with pytest.raises(OSError, match=f"is {what}"):
        FileIO(path, "ab+", opener=opened)
    with pytest.raises(RunError, match=f"shards/file: is {what}"):
        require_own_files(tmp_path)


@pytest.mark.skipif(not hasattr(os, "O_NOFOLLOW"), reason="not with this system's ways to open a file")
def test_a_link_that_takes_the_place_of_a_file_in_between_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"own")
    really = os.lstat

    def too_late(asked: Path) -> os.stat_result:
        found = really(asked)
        path.unlink()
        path.symlink_to(__file__)
        return found

    monkeypatch.setattr(os, "lstat", too_late)
    with pytest.raises(OSError, match="symbolic links"):
        own_file(path)


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="is a folder"):
        own_file(tmp_path)


def test_a_file_is_read_as_far_as_it_may_be_large(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(bytes(10))
    assert read_own(path, 10) == bytes(10)
    with pytest.raises(OSError, match="has 10 bytes, and no more than 9 are read"):
        read_own(path, 9)


def test_an_open_file_has_a_place(tmp_path: Path) -> None:
    path = tmp_path / "file"
    with h5py.File(path, "w") as file:
        file.attrs["own"] = True
    with own_file(path) as stored, h5py.File(place_of(stored, path), "r") as file:
        assert file.attrs["own"]


def test_a_run_of_files_and_folders_is_taken(whole: Path) -> None:
    require_own_files(whole)
    require_own_files(whole / "not-there")
