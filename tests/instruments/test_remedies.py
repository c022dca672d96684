"""What can be done about an error of the system: advice that fits just that one."""

import errno
import os

import pytest

from instruments.remedies import refusal, remedy, unwritable


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        (errno.ENOSPC, "make room"),
        (errno.EDQUOT, "quota"),
        (errno.EROFS, "may be written to"),
        (errno.EACCES, "yours"),
        (errno.EPERM, "yours"),
        (errno.EIO, "the disk fails"),
        (errno.ESTALE, "network share"),
        (errno.ETIMEDOUT, "network share"),
        (errno.EMFILE, "ulimit -n"),
        (errno.ENFILE, "end some of the programs"),
        (errno.EFBIG, "ulimit -f"),
        (errno.ENAMETOOLONG, "shorter name"),
        (errno.EXDEV, "one file system"),
        (errno.ELOOP, "links"),
        (errno.EBUSY, "end the program"),
        (errno.ENOENT, "name another file"),
    ],
)
def test_each_error_has_its_own_advice(number: int, advice: str) -> None:
    line = unwritable("run/data.h5", OSError(number, os.strerror(number)), "name another file")
    assert line.startswith(f"run/data.h5: cannot be written ({os.strerror(number)}): ")
    assert advice in line
    assert ("make room" in line) == (number in (errno.ENOSPC, errno.EDQUOT))


@pytest.mark.parametrize(
    ("number", "others", "advice"),
    [
        (5, ("data.h5",), "close the program that has it open"),  # access denied: data.h5 cannot be replaced
        (5, (), "use a place that is yours, or have its owner open it"),
        (32, (), "close the program that has it open"),  # sharing violation
        (33, (), "close the program that has it open"),  # lock violation
    ],
)
def test_what_windows_refuses_because_it_is_open_is_told_from_what_is_not_ours(
    number: int, others: tuple[str, ...], advice: str
) -> None:
    error = OSError(errno.EACCES, "Windows' own words", "data.h5.tmp", number, *others)
    vars(error)["winerror"] = number  # elsewhere than on Windows it is not kept
    assert remedy(error, "look") == advice


def test_an_error_without_a_number_is_not_the_systems() -> None:
    assert refusal(OSError("h5py says something")) is None
    assert remedy(OSError("h5py says something"), "look") == "look"


def test_what_was_refused_is_named() -> None:
    assert refusal(OSError(errno.EROFS, "Read-only file system", "run/figures")) == (
        "run/figures: Read-only file system: use a place that may be written to"
    )
