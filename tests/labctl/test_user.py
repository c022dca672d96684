"""Who types a command, also where he has no name."""

import os
import sys

import pytest

from labctl.user import user


@pytest.fixture(autouse=True)
def unnamed(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.delenv(name, raising=False)


def test_a_name_is_shown_as_it_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOGNAME", "ada\x1b[2J")
    assert user() == r"ada\x1b[2J"


def test_the_number_of_a_container_has_no_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getuid", lambda: 54321)
    assert user() == ""


def test_on_windows_only_the_environment_has_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is no module `pwd`."""
    monkeypatch.setitem(sys.modules, "pwd", None)
    assert user() == ""
