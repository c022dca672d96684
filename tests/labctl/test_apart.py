"""What starts a process that goes on by itself, on every system."""

import subprocess
import sys

import pytest

from labctl.apart import apart


def test_it_has_a_session_of_its_own_and_the_locks() -> None:
    assert apart((7,)) == {"start_new_session": True, "pass_fds": (7,)}


def test_on_windows_it_has_a_group_and_a_console_of_its_own_without_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """There `start_new_session` means nothing, and `pass_fds` is refused.

    Without any console (DETACHED_PROCESS) what it starts itself has one with a window: in a virtual environment that is
    Python, and whoever closes the window ends it. The two flags together are as DETACHED_PROCESS alone.
    """
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0x200, raising=False)
    monkeypatch.setattr(subprocess, "CREATE_NO_WINDOW", 0x8000000, raising=False)
    assert apart((7,)) == {"creationflags": 0x8000200}
