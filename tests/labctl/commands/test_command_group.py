"""What a fresh interpreter loads before it can answer, and what the command line says of itself."""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from subprocess import CompletedProcess, run

import pytest
import typer
from typer.main import get_command

from labctl.bench.lock import held
from labctl.bench.station import Station
from labctl.commands import COMMANDS
from labctl.commands.command_group import Unloaded
from labctl.commands.main import app
from tests.checkout import ROOT
from tests.command_line import labctl as answered

HEAVY = (
    *("torch", "sklearn", "matplotlib", "scipy", "scipy.special", "h5py", "pyvisa", "numpy"),
    *("pint", "pydantic", "rich", "PIL", "pooch", "sim_backends.world.world"),
)
"""What takes long to import, and `labctl --help` needs none of."""

LOADED = """
import json, sys
from labctl.commands.main import main
try:
    main(sys.argv[1:])
finally:
    sys.stderr.write(json.dumps(sorted(sys.modules)))
"""


def labctl(
    *words: str, program: Sequence[str] = ("-m", "labctl"), environment: Mapping[str, str] = os.environ
) -> CompletedProcess[str]:
    """A command in a process of its own."""
    return run(
        [sys.executable, *program, *words],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env={**os.environ, **environment},
    )


def loaded_by(*words: str, status: int = 0) -> set[str]:
    """The packages among HEAVY that a fresh process has imported at the end of a command."""
    ended = labctl(*words, program=("-c", LOADED))
    assert ended.returncode == status, ended.stderr
    return set(json.loads(ended.stderr.splitlines()[-1])) & set(HEAVY)


class TestNothingHeavyIsImported:
    @pytest.mark.parametrize("word", ["--help", "--version"])
    def test_before_a_command_is_named(self, word: str) -> None:
        assert not loaded_by(word)

    def test_to_list_runs(self, tmp_path: Path) -> None:
        """A catalogue is read from manifests and journals; the models of `labctl show` are sklearn's."""
        assert not loaded_by("runs", str(tmp_path)) & {"torch", "sklearn", "matplotlib", "scipy", "pyvisa", "pint"}

    def test_to_open_a_bench_that_is_not_simulated(self, tmp_path: Path) -> None:
        station = tmp_path / "bench.toml"
        silent = "address = 'TCPIP0::127.0.0.1::9::SOCKET'\n"
        named = "".join(f"[{name}]\n{silent}" for name in ("awg", "scope", "dmd", "patch_panel"))
        station.write_text(f"{named}[laser]\n{silent}commands = 'simulated'\n", encoding="utf-8")
        found = loaded_by("check", "--station", str(station), status=1)
        assert not found & {"torch", "sklearn", "matplotlib", "scipy", "h5py", "sim_backends.world.world"}

    @pytest.mark.parametrize("task", [("check",), ("align",), ("run", "image-readout"), ("live",)])
    def test_to_say_that_another_has_the_bench(self, tmp_path: Path, task: tuple[str, ...]) -> None:
        bench = Station.model_validate({"scope": {"address": "TCPIP0::192.0.2.1::INSTR"}, "laser": {"armed": False}})
        station = tmp_path / "bench.toml"
        station.write_text('[scope]\naddress = "TCPIP0::192.0.2.1::INSTR"\n[laser]\narmed = false\n', encoding="utf-8")
        with held(bench, "somebody else"):
            assert loaded_by(*task, "--station", str(station), status=1) == {"pydantic"}


class TestHelp:
    def test_a_command_is_listed_by_the_first_line_of_its_own_help(self) -> None:
        """One source: what is listed without loading is what the loaded command says of itself."""
        for name, place in COMMANDS.items():
            unloaded = Unloaded(name, place)
            assert (unloaded.load().help or "").splitlines()[0] == unloaded.get_short_help_str(), name

    def test_every_command_has_help_of_its_own(self) -> None:
        root = get_command(app)
        with typer.Context(root, info_name="labctl") as context:
            for name in COMMANDS:
                found = root.resolve_command(context, [name])[1]  # type: ignore[attr-defined]
                assert found.get_help(typer.Context(found, info_name=name)).startswith(f"Usage: {name}")

    def test_a_mistyped_command_is_put_right(self) -> None:
        ended = labctl("vrify")
        assert ended.returncode == 2
        assert "No such command 'vrify'. Did you mean 'verify'" in ended.stderr


def test_the_version_names_the_distribution_and_the_revision() -> None:
    ended = labctl("--version")
    assert ended.returncode == 0
    assert ended.stdout.startswith(f"labctl {version('photonic-labctl')}")
    assert ended.stdout.count("\n") == 1
    assert ("git " in ended.stdout) == (ROOT / ".git").exists()


class TestCompletion:
    """What a shell is told when somebody presses the tabulator key."""

    def test_the_script_is_printed(self) -> None:
        ended = labctl("--show-completion", "bash", environment={"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"})
        assert ended.returncode == 0
        assert "_LABCTL_COMPLETE=complete_bash" in ended.stdout

    @pytest.mark.parametrize(
        ("line", "completed"),
        [
            ("labctl re", ["reproduce", "resume", "report", "record", "replay"]),
            ("labctl sim serve --twin", ["--twin-seed"]),
        ],
    )
    def test_commands_and_their_options(self, line: str, completed: list[str]) -> None:
        words = len(line.split()) - 1
        asked = {"_LABCTL_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(words)}
        ended = labctl(environment=asked)
        assert ended.returncode == 0
        assert ended.stdout.split() == completed


@pytest.mark.parametrize("words", [("--out", ""), ("--out=",)])
def test_an_out_without_a_name_is_not_the_folder_one_is_in(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    commands = {name: Unloaded(name, place).load() for name, place in COMMANDS.items()}
    making = [name for name, command in commands.items() if any("--out" in one.opts for one in command.params)]
    told = "labctl: --out is empty: name what to make (the shell may not know its variable), or leave it out\n"
    assert {name: answered(capsys, name, *words) for name in making} == dict.fromkeys(making, (2, "", told))
    assert not list(tmp_path.iterdir())


def test_behind_a_dash_dash_is_no_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert "is empty" not in answered(capsys, "show", "--", "--out", "")[2]


def test_ctrl_c_while_the_command_is_loaded_ends_it_without_a_traceback(tmp_path: Path) -> None:
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt\n", encoding="utf-8")
    ended = labctl("runs", environment=os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))})
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")
