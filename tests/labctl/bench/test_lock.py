"""Where an address leads, and who holds what is there."""

import os
import resource
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest

from labctl.bench import lock_file
from labctl.bench.holder import place_of
from labctl.bench.lock import held, in_use
from labctl.bench.lock_file import LockFile
from labctl.bench.station import Station
from labctl.errors import BenchInUse


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("TCPIP0::127.0.0.1::4000::SOCKET", "tcpip::localhost::4000::socket"),
        ("TCPIP::192.0.2.1::INSTR", "TCPIP0::192.0.2.1::inst0::INSTR"),
        ("TCPIP::192.0.2.1", "TCPIP0::192.0.2.1::inst0::INSTR"),
        ("TCPIP::192.0.2.1::hislip0", "tcpip0::192.0.2.1::HISLIP0::instr"),
        ("USB::0x0699::0x0503::B019::INSTR", "USB0::0x0699::0x0503::B019::0::INSTR"),
        ("TCPIP0::127.0.0.1,5000::inst0::INSTR", "TCPIP0::localhost,5000::inst0::INSTR"),
        ("TCPIP::192.0.2.1::5025::SOCKET", "TCPIP::192.0.2.1::05025::SOCKET"),
        ("TCPIP::192.0.2.1::hislip0::INSTR", "TCPIP::192.0.2.1::hislip0,4880::INSTR"),
        ("TCPIP::192.0.2.1,5000::inst0::INSTR", "TCPIP::192.0.2.1,05000::INSTR"),
        ("TCPIP::192.0.2.1::gpib0,5::INSTR", "TCPIP::192.0.2.1::gpib0,05::INSTR"),
        ("USB::0x0699::0x0503::B019::INSTR", "USB::1689::0x503::B019::INSTR"),
        ("GPIB0::5::INSTR", "GPIB::05"),
        ("ASRL/dev/ttyUSB0::INSTR", "asrl/dev/../dev/ttyUSB0"),
        ("usb", "USB"),
    ],
)
def test_one_place_under_two_names(one: str, other: str) -> None:
    assert place_of(one) == place_of(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("TCPIP0::127.0.0.1::4000::SOCKET", "TCPIP0::127.0.0.1::4001::SOCKET"),
        ("TCPIP::192.0.2.1::gpib0,5::INSTR", "TCPIP::192.0.2.1::gpib0,6::INSTR"),
        ("TCPIP0::127.0.0.1,5000::inst0::INSTR", "TCPIP0::127.0.0.1,5001::inst0::INSTR"),
        ("TCPIP::192.0.2.1::hislip0::INSTR", "TCPIP::192.0.2.1::INSTR"),
        ("TCPIP::192.0.2.1::4000::SOCKET", "TCPIP::192.0.2.1::INSTR"),
        ("TCPIP::192.0.2.1::hislip0::INSTR", "TCPIP::192.0.2.1::hislip0,4881::INSTR"),
        ("USB::0x0699::0x0503::10::INSTR", "USB::0x0699::0x0503::010::INSTR"),
        ("ASRL1::INSTR", "ASRL2::INSTR"),
        ("ASRL/dev/ttyUSB0::INSTR", "ASRL/dev/ttyusb0::INSTR"),
    ],
)
def test_two_places(one: str, other: str) -> None:
    assert place_of(one) != place_of(other)


def test_a_serial_port_under_another_name(tmp_path: Path) -> None:
    port, link = tmp_path / "ttyUSB0", tmp_path / "usb-FTDI:0-port0"
    link.symlink_to(port)
    assert place_of(f"ASRL{link}::INSTR") == place_of(f"ASRL{port}::INSTR")


def test_two_devices_behind_one_usb_library() -> None:
    one, other, another = (
        Station.model_validate({"dmd": {"address": "usb", **device}, "laser": {"armed": False}})
        for device in ({"serial_number": 1}, {"serial_number": 2}, {"driver": "ti-dlpc900"})
    )
    with held(one, "labctl align"), held(other, "labctl align"), held(another, "labctl align"):
        for station in (one, other, another):
            with pytest.raises(BenchInUse, match=r"^dmd is in use: labctl align"), held(station, "labctl check"):
                pass


def test_a_lock_goes_from_one_to_the_next_and_leaves_no_file() -> None:
    first, second = LockFile("a test of locks"), LockFile("a test of locks")
    assert (first.lock(), second.lock()) == (True, False)
    first.write(b"first")
    assert second.note == b"first"
    path = first._path
    first.close()
    assert not path.exists()
    assert second.lock()
    assert path.exists()
    second.close()
    assert not path.exists()


def test_what_can_be_done_about_a_lock_that_is_not_to_be_had(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    try:
        with pytest.raises(BenchInUse) as refused:
            LockFile("a test of locks")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert str(refused.value).endswith("(Too many open files): a process may open more files after 'ulimit -n 1024'")
    monkeypatch.setattr(lock_file, "_folder", lambda: tmp_path)
    lock = LockFile("somebody's")
    lock.close()
    lock._path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BenchInUse, match=r"cannot be locked \(.*\): remove it, or ask whose it is$"):
        LockFile("somebody's")


def test_on_windows_it_is_closed_before_it_is_removed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """There no file is removed while it is open, and one that stays is the next user's to read only."""
    monkeypatch.setattr(lock_file, "sys", SimpleNamespace(platform="win32"))
    monkeypatch.setenv("PROGRAMDATA", str(tmp_path))
    remove = Path.unlink

    def remove_closed(path: Path) -> None:
        if not lock._file.closed:
            raise PermissionError(13, "The process cannot access the file", str(path))
        remove(path)

    monkeypatch.setattr(Path, "unlink", remove_closed)
    lock = LockFile("a test of locks")
    assert lock.lock()
    lock.close()
    assert list(tmp_path.glob("*/*")) == []


@pytest.fixture
def another_users(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> LockFile:
    """It can be read only, as on Windows, where a file in a folder for all users is its owner's to write."""
    monkeypatch.setattr(lock_file, "_folder", lambda: tmp_path)
    lock = LockFile("a test of locks")
    assert lock.lock()
    open_it = os.open

    def open_to_read(path: str, flags: int, mode: int = 0o666) -> int:
        if flags & os.O_RDWR and not flags & os.O_CREAT:
            raise PermissionError(13, "Permission denied", path)
        return open_it(path, flags, mode)

    monkeypatch.setattr(os, "open", open_to_read)
    return lock


def test_what_another_user_has_left_can_be_locked(another_users: LockFile) -> None:
    another_users.write(b"another user")
    ours = LockFile("a test of locks")
    assert (ours.lock(), ours.note) == (False, b"another user")
    another_users._file.close()  # killed
    assert ours.lock()
    ours.write(b"this user")
    with closing(LockFile("a test of locks")) as third:
        assert (third.lock(), third.note) == (False, b"another user")
        ours.close()
        assert third.lock()


def test_a_pipe_in_the_place_of_a_lock_is_not_waited_for(another_users: LockFile) -> None:
    another_users.close()
    os.mkfifo(another_users._path)
    LockFile("a test of locks").close()


def test_who_holds_it_is_told_also_while_he_writes_which_run_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    station = Station.model_validate({"awg": {"address": "TCPIP::192.0.2.9::INSTR"}, "laser": {"armed": False}})
    with held(station, "labctl align"):
        lock = LockFile(place_of("TCPIP::192.0.2.9::INSTR"))
        looks = [lock.note, b"", lock.note]
        lock._file.close()
        monkeypatch.setattr(LockFile, "note", property(lambda _lock: looks.pop(0)))
        with pytest.raises(BenchInUse, match=r"^awg is in use: labctl align, process"), held(station, "labctl check"):
            pass


def test_who_has_it_is_seen_without_taking_it() -> None:
    station = Station.model_validate({"awg": {"address": "TCPIP::192.0.2.8::INSTR"}, "laser": {"armed": False}})
    assert in_use(station) == ""
    with held(station, "labctl align"):
        assert in_use(station).startswith("awg is in use: labctl align, process ")
    assert in_use(station) == ""


def test_what_a_supervisor_still_holds_is_let_go_by_a_word_about_its_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("labctl.bench.lock.DARK_WITHIN_S", 0.0)
    station = Station.model_validate({"awg": {"address": "TCPIP::192.0.2.7::INSTR"}, "laser": {"armed": False}})
    with held(station, "a run of image-readout") as hold:
        hold.stored_in(tmp_path / "night run")
        (inherited,) = map(os.dup, hold.descriptors)
    told = rf"^awg is in use: .* was ended with light on, .*: labctl dark '{tmp_path}/night run'$"
    with pytest.raises(BenchInUse, match=told), held(station, "labctl check"):
        pass
    os.close(inherited)
    with held(station, "labctl check"):
        pass
