"""What a full disk does to a run, on a small file system of its own: to be started where it may mount one.

Usage: `on_a_small_disk.py FOLDER STATION PROTOCOL...`. One line of JSON on standard output.
"""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from io import FileIO
from pathlib import Path
from typing import Any

from labctl.errors import RunError
from labctl.runs.verification import verify_run
from labctl.runs.write.writer import RunWriter
from tests.command_line import LABCTL
from tests.labctl.runs.conftest import SMALL, begin, measure_missing
from tests.system.waiting import until_stored

SIZE = 1 << 21
PAGE = 1 << 12


def fill(ballast: Path, leave: int = 0) -> None:
    """Take all that is free but for so many bytes, as another program may at night."""
    with FileIO(ballast, "w") as file:
        try:
            while True:
                file.write(bytes(PAGE))
        except OSError:
            file.truncate(file.tell() - leave)


def while_a_run_goes_on(folder: Path, station: str, protocol: list[str]) -> dict[str, Any]:
    """Full after the first shard; then there is room again."""
    directory, ballast = folder / "run", folder / "ballast"
    command = [*LABCTL, "run", *protocol, "--station", station, "--out", str(directory)]
    journal = directory / "journal.jsonl"
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        until_stored(process, directory)
        acknowledged = journal.read_bytes().count(b"\n")
        fill(ballast)
        _, told = process.communicate()
    report = verify_run(directory)
    ballast.unlink()
    resumed = subprocess.run([*LABCTL, "resume", str(directory), "--json"], capture_output=True, text=True, check=False)
    return {
        "status": process.returncode,
        "told": told,
        "acknowledged": acknowledged,
        "intact": report.intact,
        "stored": sum(report.passes) + report.suspect,
        "resumed": json.loads(resumed.stdout),
    }


def while_data_is_made(folder: Path) -> dict[str, Any]:
    """Every shard is stored, and two pages are free when data.h5 is to be made of them."""
    directory, ballast = folder / "whole", folder / "ballast"
    shape = replace(SMALL, shots=60, samples=500)
    writer = begin(directory, shape, 5)
    measure_missing(writer, shape)
    fill(ballast, 2 * PAGE)
    try:
        writer.finish()
        told = ""
    except RunError as error:
        told = str(error)
    report = verify_run(directory)
    ballast.unlink()
    with RunWriter.resume(directory) as again:
        again.finish()
    return {
        "told": told,
        "intact": report.intact,
        "complete": report.complete,
        "left": [path.name for path in directory.rglob("*.tmp")],
        "data_file": verify_run(directory).data_file,
    }


def while_runs_are_looked_for(folder: Path) -> list[str]:
    """A catalogue is there, and one run has another name when no page is free any more."""

    def listed() -> list[str]:
        command = [*LABCTL, "runs", str(folder), "--json"]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        return [Path(one["run"]).name for one in json.loads(ended.stdout).get("runs", ())]

    found = listed()
    (folder / "whole").rename(folder / "other")
    fill(folder / "ballast")
    return [*found, *listed()]


if __name__ == "__main__":
    where = Path(sys.argv[1])
    mount = shutil.which("mount") or "mount"
    subprocess.run([mount, "-t", "tmpfs", "-o", f"size={SIZE}", "none", str(where)], check=True)
    found: dict[str, Any] = {
        "run": while_a_run_goes_on(where, sys.argv[2], sys.argv[3:]),
        "data": while_data_is_made(where),
    }
    found["listed"] = while_runs_are_looked_for(where)
    print(json.dumps(found))  # noqa: T201
