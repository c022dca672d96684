"""`make test-light TRIALS=20`: whoever is killed or stopped while the laser emits, how soon is it dark, and by whom?

Runs of `labctl run` on a served bench, software-timed and in bursts by turns. The laser is asked over a connection of
its own; who made it dark stands in the log of the run. Exit 1 if it was not dark within a second.
"""

import argparse
import json
import os
import random
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.command_line import LABCTL
from tests.system.waiting import until_stored

RUN = ("run", "image-readout", "--set", "images=2000", "--set", "window=0.8 ns")
DARK_WITHIN_S = 1.0
PATIENCE_S = 20.0
LATER_S = 0.3
"""At most so long after a run has its first shots, it is killed; and after its supervisor, where both are."""

Strike = Callable[[int, int, random.Random], None]
"""What befalls a run: the numbers of its process and of its supervisor."""


def _both(run: int, supervisor: int, _generator: random.Random) -> None:
    os.kill(supervisor, signal.SIGKILL)
    os.kill(run, signal.SIGKILL)


def _both_by_and_by(run: int, supervisor: int, generator: random.Random) -> None:
    os.kill(supervisor, signal.SIGKILL)
    time.sleep(generator.uniform(0, LATER_S))
    os.kill(run, signal.SIGKILL)


def _with_the_copy(run: int, supervisor: int, generator: random.Random) -> None:
    killed = [run, _child_of(supervisor)]
    generator.shuffle(killed)
    for process in killed:
        os.kill(process, signal.SIGKILL)


def _child_of(process: int) -> int:
    return int(Path(f"/proc/{process}/task/{process}/children").read_text().split()[0])


STRIKES: dict[str, Strike] = {
    "run killed": lambda run, _supervisor, _generator: os.kill(run, signal.SIGKILL),
    "its process group killed": lambda run, _supervisor, _generator: os.killpg(run, signal.SIGKILL),
    "run stopped": lambda run, _supervisor, _generator: os.kill(run, signal.SIGSTOP),
    "supervisor killed": lambda _run, supervisor, _generator: os.kill(supervisor, signal.SIGKILL),
    "supervisor stopped": lambda _run, supervisor, _generator: os.kill(supervisor, signal.SIGSTOP),
    "both killed": _both,
    "supervisor killed, then the run": _both_by_and_by,
    "run and copy killed": _with_the_copy,
}


@dataclass
class Darkened:
    """How soon the laser was dark (s), and by whom; `findings` are the lines of what must not be."""

    seconds: list[float] = field(default_factory=list)
    by: Counter[str] = field(default_factory=Counter)
    findings: list[str] = field(default_factory=list)


class Laser:
    """Its own answer, over a connection of our own."""

    def __init__(self, address: str) -> None:
        """At a VISA address."""
        _, host, port, _ = address.split("::")
        self._link = socket.create_connection((host, int(port)), timeout=PATIENCE_S)
        self._answers = self._link.makefile("rb")

    def close(self) -> None:
        """Let go of it."""
        self._answers.close()
        self._link.close()

    def emits(self) -> bool:
        """Whether it does now."""
        self._link.sendall(b"OUTPUT?\n")
        return self._answers.readline().strip() == b"1"

    def seconds_until(self, *, emits: bool) -> float:
        """How long that takes; infinite where it is too long."""
        began = time.monotonic()
        while self.emits() is not emits:
            time.sleep(1e-3)  # the processor is for the run
            if time.monotonic() - began > PATIENCE_S:
                return float("inf")
        return time.monotonic() - began


@contextmanager
def _served(folder: Path) -> Iterator[tuple[Laser, Path]]:
    station = folder / "station.toml"
    command = [*LABCTL, "sim", "serve", "--json", "--save-station", str(station)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            with closing(Laser(json.loads(server.stdout.readline())["resources"]["laser"]["socket"])) as laser:
                yield laser, station
        finally:
            server.terminate()


def strike(folder: Path, trials: int, seed: int, names: tuple[str, ...] = tuple(STRIKES)) -> dict[str, Darkened]:
    """Let each of these befall so many runs in `folder`."""
    generator = random.Random(seed)  # noqa: S311 - moments, no secrets
    found = {name: Darkened() for name in names}
    with _served(folder) as (laser, station):
        for trial in range(trials):
            for name, darkened in found.items():
                directory = folder / "run"
                _one_run(
                    laser, station, directory, ("software", "burst")[trial % 2], STRIKES[name], generator, darkened
                )
                shutil.rmtree(directory)
            sys.stderr.write(f"{trial + 1} of {trials} trials of each kind\n")
    return found


def _one_run(
    laser: Laser,
    station: Path,
    directory: Path,
    timing: str,
    befalls: Strike,
    generator: random.Random,
    darkened: Darkened,
) -> None:
    command = [*LABCTL, *RUN, "--set", f"timing={timing}", "--station", str(station), "--out", str(directory)]
    with subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
        env=os.environ | {"XDG_STATE_HOME": str(directory.parent)},
    ) as process:
        until_stored(process, directory)
        time.sleep(generator.uniform(0, LATER_S))
        supervisor = _child_of(process.pid)
        laser.seconds_until(emits=True)  # it is dark between bursts
        befalls(process.pid, supervisor, generator)
        seconds = laser.seconds_until(emits=False)
        _, said = process.communicate(timeout=PATIENCE_S)
    darkened.seconds.append(seconds)
    darkened.by[_by(directory)] += 1
    if seconds > DARK_WITHIN_S:
        darkened.findings.append(f"{timing}: dark after {seconds:.2f} s: {' '.join(said.split())}")


def _by(directory: Path) -> str:
    """Who said last that the bench is safe; what it says comes after the dark."""
    give_up = time.monotonic() + PATIENCE_S
    while time.monotonic() < give_up:
        lines = (directory / "events.jsonl").read_bytes().split(b"\n")[:-1]
        safe = [event for line in lines if (event := json.loads(line))["event"] == "safe state"]
        if safe and safe[-1]["reached"]:
            return str(safe[-1].get("by", "the run itself"))
        time.sleep(1e-2)
    return "nobody said"


def _row(name: str, darkened: Darkened) -> dict[str, Any]:
    seconds = darkened.seconds
    return {
        "what befell it": name,
        "trials": len(seconds),
        "least_s": round(min(seconds), 3),
        "median_s": round(statistics.median(seconds), 3),
        "most_s": round(max(seconds), 3),
        "dark by": dict(darkened.by),
        "findings": darkened.findings,
    }


def main() -> int:
    """Do it as often as asked for, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=20, help="of each kind")
    parser.add_argument("--seed", type=int, default=1, help="of the moments")
    parser.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    asked = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="labctl-light-"))
    found = strike(folder, asked.trials, asked.seed)
    shutil.rmtree(folder)
    rows = [_row(name, darkened) for name, darkened in found.items()]
    if asked.json:
        sys.stdout.write(json.dumps({"seed": asked.seed, "rows": rows}) + "\n")
    else:
        for row in rows:
            by = ", ".join(f"{who} {count}" for who, count in row["dark by"].items())
            sys.stdout.write(
                f"{row['what befell it']:34}{row['trials']:4}{row['least_s']:8.3f}{row['median_s']:8.3f}"
                f"{row['most_s']:8.3f} s  {by}\n"
            )
    for row in rows:
        for finding in row["findings"]:
            sys.stderr.write(f"FINDING: {row['what befell it']}: {finding}\n")
    return 1 if any(row["findings"] for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
