"""`make test-kill TRIALS=300 SEED=1`: SIGKILL at random moments of runs on the simulated bench, and of resumed ones.

A moment is drawn uniformly from the whole life of a process: before the run directory exists, while ranges are found,
in either pass, while data.h5 is made. Half of the processes that go on with a killed run are killed as well. Every run
is brought to its end and compared with one that was never interrupted. Exit 1 if anything is missing that must not be.
"""

import argparse
import json
import random
import secrets
import shutil
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

from labctl.engine.session import Acquisition, acquire
from labctl.runs.read.run import open_run
from tests.kills.checks import Figures, check_ended, check_killed, on_disk, stage
from tests.kills.lives import Kind, kinds, live

AGAIN = 0.5
"""Of the processes that go on with a killed run, so many are killed too."""

MEASURED_AGAIN = 12
"""After so many runs it is measured again how long one takes: whatever else the machine does changes that."""


@dataclass(frozen=True)
class Whole:
    """A run that was not interrupted: digest of its frames, records, and how long it took (s)."""

    digest: str
    records: int
    life_s: float
    until_first_shot_s: float

    def rest_s(self, there: int) -> float:
        """How long a process takes that begins with so many records on disk."""
        return self.until_first_shot_s + (self.life_s - self.until_first_shot_s) * (1 - there / self.records)


def main() -> int:
    """Kill as often as asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=300, help="how many kills")
    parser.add_argument("--seed", type=int, default=None, help="of the moments; drawn and printed without it")
    parser.add_argument("--images", type=int, default=80, help="of each run")
    parser.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    asked = parser.parse_args()
    seed = secrets.randbits(32) if asked.seed is None else asked.seed
    began = time.monotonic()
    folder = Path(tempfile.mkdtemp(prefix="labctl-kills-"))
    figures = kill(folder, asked.trials, seed, asked.images)
    for finding in figures.findings:
        sys.stderr.write(f"FINDING: {finding}\n")
    if not figures.findings:
        shutil.rmtree(folder)
    result = _result(figures, seed, time.monotonic() - began)
    sys.stdout.write(json.dumps(result) + "\n" if asked.json else _text(result))
    return 1 if figures.findings else 0


def kill(folder: Path, kills: int, seed: int, images: int) -> Figures:
    """Acquire runs in `folder`, a kind after the other, and kill and resume them until there were so many kills."""
    generator = random.Random(seed)  # noqa: S311 - moments, no secrets
    chosen = kinds(images)
    acquire(Acquisition(chosen[0].protocol, chosen[0].station, folder / "warm"))  # imports what is imported late
    figures = Figures(stages={kind.name: Counter() for kind in chosen})
    for number, kind in enumerate(cycle(chosen)):
        if figures.kills >= kills:
            return figures
        if number % MEASURED_AGAIN == 0:
            wholes = {kind: _whole(kind, folder / "whole", folder / "told") for kind in dict.fromkeys(chosen)}
        _one_run(figures, kind, wholes[kind], folder / str(number), kills, generator)
        sys.stderr.write(f"{figures.kills} of {kills} kills, {figures.runs} runs, {len(figures.findings)} findings\n")
        if not figures.findings:
            shutil.rmtree(folder / str(number))
    raise AssertionError  # a cycle has no end


def _whole(kind: Kind, directory: Path, told: Path) -> Whole:
    life = live(kind, directory, told, None)
    with open_run(directory) as run:
        digest = run.digest()
    whole = Whole(digest, on_disk(directory), life.ended - life.began, life.told.done[0][0] - life.began)
    shutil.rmtree(directory)
    return whole


def _one_run(figures: Figures, kind: Kind, whole: Whole, directory: Path, kills: int, generator: random.Random) -> None:
    there, first, killing = 0, True, True
    while True:
        moment = generator.uniform(0, whole.rest_s(there))
        life = live(kind, directory, directory.with_name("told"), moment if killing else None)
        if not life.killed:
            figures.acknowledged += whole.records - there
            check_ended(figures, directory, whole.digest)
            return
        figures.kills += 1
        figures.stages[kind.name][stage(directory, life, first=first, records=whole.records)] += 1
        there = check_killed(figures, kind, directory, life, there)
        first = first and not directory.exists()
        killing = figures.kills < kills and generator.random() < AGAIN


def _result(figures: Figures, seed: int, seconds: float) -> dict[str, Any]:
    return {
        "seed": seed,
        "kills": figures.kills,
        "runs": figures.runs,
        "acknowledged": figures.acknowledged,
        "lost_within_the_bound": figures.lost,
        "most_lost_by_one_kill": figures.most_lost,
        "lost_beyond_the_bound": figures.lost_beyond,
        "unreadable_files": figures.unreadable,
        "runs_not_byte_equal": figures.not_equal,
        "latest_write_s": round(figures.latest_s, 3),
        "longest_write_s": round(figures.longest_write_s, 3),
        "stages": {kind: dict(stages.most_common()) for kind, stages in figures.stages.items()},
        "seconds": round(seconds, 1),
        "passed": not figures.findings,
    }


def _text(result: dict[str, Any]) -> str:
    stages = result.pop("stages")
    lines = [f"{name.replace('_', ' '):28}{value}" for name, value in result.items()]
    for kind, counted in stages.items():
        lines.append(f"killed, {kind}: " + ", ".join(f"{count} {stage}" for stage, count in counted.items()))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
