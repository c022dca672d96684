"""The command line, in this process and in one of its own: what a person types, and what comes back."""

import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from typing import Any

import pytest

from labctl.commands.main import main
from labctl.dashboard import launcher

LABCTL = (sys.executable, "-c", launcher.COMMAND[-1])
"""How a process of the command is started."""


def labctl(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of one command."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    assert isinstance(ended.value.code, int)
    return ended.value.code, *capsys.readouterr()


def as_json(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, dict[str, Any]]:
    """Exit status of one command, and the one JSON object it printed."""
    status, out, _ = labctl(capsys, *words, "--json")
    assert out.count("\n") == 1
    found: dict[str, Any] = json.loads(out)
    return status, found


def answer(*words: object) -> tuple[int, dict[str, Any], str]:
    """The same of a command with `--json` among its words, for whoever has no `capsys`; and what it told people."""
    out, told = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(told), pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    assert isinstance(ended.value.code, int)
    assert out.getvalue().count("\n") == 1
    return ended.value.code, json.loads(out.getvalue()), told.getvalue()
