"""What commands say on a disk that takes nothing, on a small file system of its own.

Usage: `on_a_closed_disk.py FOLDER RUN KIND...`, each full, read-only or few-files: started where it may mount one for
each. One line of JSON.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path

from tests.forked_processes import TYPED, load
from tests.system.on_a_small_disk import SIZE, fill
from tests.system.watched_commands import carry_out

MOUNT = shutil.which("mount") or "mount"
FILES = 10


def few_files() -> None:
    """So many open files at most."""
    import resource

    resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, FILES))


def said(folder: Path, run: Path, what: str) -> dict[str, tuple[int, str, str]]:
    """Exit status, output and errors of each command."""
    (folder / "run").mkdir()
    shutil.copytree(run, folder / "run", dirs_exist_ok=True)
    model = shutil.copy(next((run / "models").iterdir()), folder / "model.h5")
    if what == "full":
        fill(folder / "ballast")
    if what == "read-only":
        subprocess.run([MOUNT, "-o", "remount,bind,ro", str(folder)], check=True)
    run, missing = folder / "run", folder / "missing"
    commands = {
        "verify": ("verify", run, "--rebuild"),
        "train": ("train", run, "--out", folder / "m.h5"),
        "evaluate": ("evaluate", model, run),
        "report": ("report", run),
        "show": ("show", run),
        "run": ("run", "image-readout", "--set", "images=4", "--out", missing),
        "align": ("align", "--out", missing),
        "init": ("init", folder / "bench.toml"),
        "schema": ("schema", "--write", missing),
        **{
            f"export {to}": ("export", run, "--to", to, "--out", folder / f"x.{to}")
            for to in ("npz", "csv", "netcdf", "zarr")
        },
    }
    limit = few_files if what == "few-files" else lambda: None
    ended = {name: carry_out([*map(str, words), "--json"], limit) for name, words in commands.items()}
    return {name: (one["status"], one["out"], one["said"]) for name, one in ended.items()}


def main(folder: str, run: str, *kinds: str) -> None:
    load(TYPED)
    found = {}
    for what in kinds:
        where = Path(folder) / what
        where.mkdir()
        subprocess.run([MOUNT, "-t", "tmpfs", "-o", f"size={4 * SIZE}", "none", str(where)], check=True)
        found[what] = said(where, Path(run), what)
    print(json.dumps(found))  # noqa: T201


if __name__ == "__main__":
    main(*sys.argv[1:])
