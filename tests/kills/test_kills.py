"""The short form of `make test-kill`."""

import json
import os
import subprocess
import sys

import pytest

from tests.checkout import ROOT

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="needs fork and pidfd_open")

KILLS = 10


def test_killed_runs_lose_nothing_beyond_the_bound_and_end_as_if_they_had_not_been() -> None:
    command = [
        sys.executable,
        "-m",
        "tests.kills.run",
        "--trials",
        str(KILLS),
        "--seed",
        "1",
        "--images",
        "20",
        "--json",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["kills"], found["passed"]) == (KILLS, True)
    assert (found["lost_beyond_the_bound"], found["unreadable_files"], found["runs_not_byte_equal"]) == (0, 0, 0)
    assert found["acknowledged"] > 0
    assert sum(sum(stages.values()) for stages in found["stages"].values()) == KILLS
