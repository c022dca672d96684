"""Runs made by an attacker, put through every command: nothing is opened or written, no bench is reached, one line."""

import json
import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from labctl.commands.main import main
from tests.checkout import ROOT
from tests.forked_processes import WATCHED

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs links, pipes and fork")

PATIENCE_S = 300
ESCAPES = "\x1b]0;owned\x07\x1b[2J\u202e\x9b31m\x7f\ud800\r\nlabctl: all is well"

Made = Callable[[Path, Path], object]
"""Makes something strange at a path; the second path is that of somebody's secret."""


def link(path: Path, secret: Path) -> None:
    path.symlink_to(secret)


def dangling(path: Path, secret: Path) -> None:
    path.symlink_to(secret.with_name("not-there"))


def endless(path: Path, _secret: Path) -> None:
    path.symlink_to("/dev/zero")


def folder(path: Path, secret: Path) -> None:
    path.symlink_to(secret.parent)


def pipe(path: Path, _secret: Path) -> None:
    os.mkfifo(path)


def listening(path: Path, _secret: Path) -> None:
    here = os.open(path.parent, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(f"/proc/self/fd/{here}/{path.name}")  # a socket's whole path has no more than 108 letters
    os.close(here)


FILES = (
    "manifest.json",
    "plan.h5",
    "journal.jsonl",
    "events.jsonl",
    "commands.log",
    "data.h5",
    "shards/000000.h5",
    "shards/000001.h5",
    "control",
    "report.html",
    "models/softmax.h5",
    "figures/shown-traces.png",
)
STRANGE: dict[str, tuple[str, Made]] = {
    **{f"{name} is a link": (name, link) for name in FILES},
    **{f"{name} is a pipe": (name, pipe) for name in FILES},
    **{f"{name} leads to a device": (name, endless) for name in ("manifest.json", "journal.jsonl", "data.h5")},
    **{f"{name} leads nowhere": (name, dangling) for name in ("data.h5.tmp", "report.html.partial", "events.jsonl")},
    **{f"{name} is another folder": (name, folder) for name in ("shards", "figures", "models", "figures/deep")},
    "journal.jsonl is a socket": ("journal.jsonl", listening),
}


@dataclass
class Scene:
    """A folder of runs, a whole one and those of the attacker, and somebody's secret beside it."""

    runs: Path
    secret: Path
    whole: Path
    strange: dict[str, tuple[Path, Path]]
    """The run, and what is strange in it."""

    def tree(self) -> dict[str, tuple[int, int, int, bytes]]:
        """Everything that lies there: kind, size, time of the last change, content."""
        found = {}
        for path in sorted(self.runs.parent.rglob("*")):
            about = path.lstat()
            content = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
            found[str(path)] = about.st_mode, about.st_size, about.st_mtime_ns, content
        return found


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """The attacker's runs lack some shots, so that a resume would measure them."""
    root = tmp_path_factory.mktemp("attacked")
    runs, secret = root / "runs", root / "home" / "secret"
    secret.parent.mkdir()
    secret.write_text("a secret")
    whole, cut = runs / "whole", root / "cut"
    settings = [f"--set={one}" for one in ("images=10", "ports=2,3,4,5", "window=0.8 ns")]
    with pytest.raises(SystemExit) as ended:
        main(["run", "image-readout", *settings, "--out", str(whole), "--json"])
    assert ended.value.code == 0
    shutil.copytree(whole, cut)
    (cut / "data.h5").unlink()
    (cut / "journal.jsonl").write_bytes(b"")
    strange = {}
    for number, (what, (name, make)) in enumerate(STRANGE.items()):
        run = runs / f"run{number:02d}"
        shutil.copytree(cut, run)
        path = run / name
        path.parent.mkdir(exist_ok=True)
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        make(path, secret)
        strange[what] = run, path
    return Scene(runs, secret, whole, strange)


FEW = ("show", "verify", "resume", "stop")
EVERY = ("journal.jsonl is a pipe", "shards is another folder", "data.h5 is a link")
"""Runs that are put through every command; the others through a few, since each takes a process."""


def commands(run: Path, whole: Path, out: Path) -> list[list[str]]:
    """Every command that takes a run."""
    strange, other = str(run), str(whole)
    return [
        ["show", strange],
        ["verify", strange],
        ["verify", strange, "--rebuild"],
        ["resume", strange],
        ["resume", strange, "--arm"],
        ["train", strange],
        ["evaluate", strange],
        ["evaluate", str(whole / "no-model.h5"), strange],
        ["report", strange],
        ["compare", strange, other],
        ["compare", other, strange],
        *(["export", strange, "--to", kind, "--out", str(out)] for kind in ("npz", "csv", "netcdf")),
        ["pause", strange],
        ["go-on", strange],
        ["stop", strange],
        ["stop", strange, "--now"],
    ]


def carried_out(words: list[list[str]]) -> list[dict[str, Any]]:
    ended = subprocess.run(
        [sys.executable, "-m", WATCHED],
        cwd=ROOT,
        input=json.dumps(words),
        stdout=subprocess.PIPE,
        check=True,
        text=True,
        timeout=PATIENCE_S,
    )
    return [json.loads(line) for line in ended.stdout.splitlines()]


def test_a_run_with_anything_but_files_in_it_is_refused_by_every_command(scene: Scene) -> None:
    before = scene.tree()
    out = scene.runs.parent / "out"
    asked = {
        what: [words for words in commands(run, scene.whole, out) if what in EVERY or words[0] in FEW]
        for what, (run, _) in scene.strange.items()
    }
    found = iter(carried_out([words for several in asked.values() for words in several]))
    assert scene.tree() == before
    wrong = []
    for what, several in asked.items():
        path = scene.strange[what][1]
        for words in several:
            ended = next(found)
            touched = [place for event, place in ended["touched"] if event == "open"]
            deeds = [event for event, _ in ended["touched"] if event != "open"]
            one_line = ended["said"].startswith("labctl: ") and ended["said"].count("\n") == 1
            named = str(path) in ended["said"] or words[1].endswith("no-model.h5")
            opened = {str(path), str(scene.secret), "/dev/zero"} & set(touched)
            if ended["status"] not in (1, 2) or not one_line or not named or opened or deeds or ended["out"]:
                wrong.append((what, ended))
    assert not wrong


def test_a_broken_run_does_not_break_the_list(scene: Scene) -> None:
    listed, as_text = carried_out([["runs", str(scene.runs), "--json"], ["runs", str(scene.runs)]])
    assert (listed["status"], as_text["status"], listed["said"] + as_text["said"]) == (0, 0, "")
    rows = {row["run"]: row for row in json.loads(listed["out"])["runs"]}
    assert rows[str(scene.whole)]["state"] == "complete"
    for run, path in scene.strange.values():
        assert rows[str(run)]["state"] == "unreadable"
        assert str(path) in rows[str(run)]["problem"]
        (line,) = [line for line in as_text["out"].splitlines() if line.startswith(run.name)]
        assert re.search(rf" 0/0 +{re.escape(str(path.relative_to(run)))}: is a", line)


PAGE = """
import json, sys
from pathlib import Path
from labctl.dashboard.list_wording import run_list
from labctl.dashboard.listing import Wanted
from labctl.dashboard.monitor import Watching
now = [0.0]
watching = Watching(Path(sys.argv[1]), clock=lambda: now[0])
runs = watching.listing.runs(Wanted())
seen = {}
for one in runs.found:
    watched = watching.run(one.row.name)
    watched.look()
    seen[one.row.name] = watched.problem
listed = run_list(runs)
listed.encode()
print(json.dumps([listed, seen]))
"""


def test_a_broken_run_does_not_break_the_page(scene: Scene) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", PAGE, str(scene.runs)], stdout=subprocess.PIPE, check=True, text=True, timeout=PATIENCE_S
    )
    listed, problems = json.loads(ended.stdout)
    assert problems.pop(scene.whole.name) == ""
    assert f">{scene.whole.name}</span>" in listed
    for run, path in scene.strange.values():
        assert str(path) in listed
        assert str(path) in problems[run.name]


def test_a_readout_or_a_data_file_that_is_none_is_refused(scene: Scene, tmp_path: Path) -> None:
    before = scene.tree()
    made = []
    for number, make in enumerate((link, dangling, endless, pipe, listening)):
        for name in ("model.h5", "data.h5"):
            path = tmp_path / str(number) / name
            path.parent.mkdir(exist_ok=True)
            make(path, scene.secret)
            made.append(path)
    asked = [words for path in made for words in (["evaluate", str(path), str(scene.whole)], ["verify", str(path)])]
    asked += [["show", str(path)] for path in made if not path.is_file() or path.name == "data.h5"]
    for ended in carried_out(asked):
        assert ended["status"] in (1, 2), ended
        assert ended["said"].startswith("labctl: "), ended
        assert ended["said"].count("\n") == 1, ended
        assert not {*map(str, made), str(scene.secret)} & {place for _, place in ended["touched"]}, ended
    assert scene.tree() == before


def test_a_data_file_by_itself_draws_into_no_other_folder(scene: Scene, tmp_path: Path) -> None:
    shutil.copy(scene.whole / "data.h5", tmp_path / "data.h5")
    (tmp_path / "figures").symlink_to(scene.secret.parent)
    (ended,) = carried_out([["show", str(tmp_path / "data.h5")]])
    assert (ended["status"], ended["said"].count("\n")) == (2, 1)
    assert "figures: is a link to another place" in ended["said"]
    assert [path.name for path in scene.secret.parent.iterdir()] == ["secret"]


def test_what_a_terminal_would_obey_never_reaches_it(scene: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    run = folder / "\x1b[31mred\u202e\udcff\nlabctl: all is well"
    shutil.copytree(scene.whole, run)
    manifest = json.loads((run / "manifest.json").read_text())
    manifest |= {"started": ESCAPES, "git_revision": ESCAPES}
    manifest["protocol"] |= {"name": f"image-readout{ESCAPES}"}
    manifest["station"]["name"] = ESCAPES
    manifest["instruments"]["scope"]["identity"] = {ESCAPES: ESCAPES}
    (run / "manifest.json").write_text(json.dumps(manifest))
    (run / "shards" / f"{ESCAPES.encode('utf-16', 'surrogatepass').hex()}\x1b[2J.tmp").touch()
    words = [["runs", str(folder)], *commands(run, scene.whole, tmp_path / "out"), ["show", str(run / "data.h5")]]
    words.append(["run", "image-readout", "--set", f"dataset={ESCAPES.encode(errors='ignore').decode()}"])
    words.append([f"no-such-command{ESCAPES.encode(errors='ignore').decode()}"])
    words += [[*one, "--json"] for one in words] + [[*one, "--debug"] for one in words]
    for ended in carried_out(words):
        printed = ended["out"] + ended["said"]
        assert all(letter == "\n" or letter.isprintable() for letter in printed), ended
        assert "\nlabctl: all is well" not in printed or "--debug" in ended["command"], ended
        if "--json" in ended["command"] and ended["out"]:
            assert ended["out"].isascii()
            json.loads(ended["out"])
