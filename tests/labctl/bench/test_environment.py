"""`labctl doctor`: what works on this machine, what is missing and what it is for."""

import json
import os
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path
from subprocess import run

import pytest

from labctl.bench.environment import BROKEN, EXTRAS, MISSING, OK, Finding, examine
from labctl.commands.main import main
from tests.checkout import ROOT


@pytest.fixture(scope="module")
def findings() -> dict[tuple[str, str], Finding]:
    return {(found.about, found.name): found for found in examine()}


def test_the_core_works_here(findings: dict[tuple[str, str], Finding]) -> None:
    assert not [found for found in findings.values() if found.state == BROKEN]
    assert findings["package", "numpy"] == Finding("package", "numpy", OK, version("numpy"))
    assert findings["labctl", "version"].says.startswith(version("photonic-labctl"))
    assert findings["labctl", "python"].says.startswith(sys.version.split()[0])
    assert findings["VISA", "TCPIP SOCKET"].state == OK
    assert findings["driver", "tektronix-awg70002a"].says == "awg of photonic-labctl"
    assert findings["protocol", "image-readout"].state == OK
    assert findings["data set", "mnist-0-3"].state == OK
    assert "GB free" in findings["disk", str(Path.cwd())].says


def test_what_is_missing_says_what_it_is_for(findings: dict[tuple[str, str], Finding]) -> None:
    for found in findings.values():
        if found.about == "extra":
            how = f': pip install "photonic-labctl[{found.name}]"'  # quotes that every shell knows
            assert found.says == EXTRAS[found.name] + how * (found.state == MISSING)
        if found.about == "data set" and found.state == MISSING:
            assert "labctl data fetch" in found.says or "LABCTL_DATA" in found.says or "http" in found.says


def test_every_extra_for_users_is_explained() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    assert declared.keys() - {"build", "dev", "docs"} == EXTRAS.keys()


def test_a_plug_in_that_does_not_load_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plug_in = tmp_path / "other_lab-1.0.dist-info"
    plug_in.mkdir()
    (plug_in / "METADATA").write_text("Metadata-Version: 2.1\nName: other-lab\nVersion: 1.0\n", "utf-8")
    (plug_in / "entry_points.txt").write_text("[labctl.instruments]\ntheir-laser = other_lab:laser\n", "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    (found,) = [found for found in examine() if found.name == "their-laser"]
    assert found == Finding("driver", "their-laser", MISSING, "of other-lab does not load: No module named 'other_lab'")


def test_as_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["doctor", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert ended.value.code == 0
    assert found["ok"] is True
    assert {"about": "package", "name": "numpy", "state": "ok", "says": version("numpy")} in found["findings"]


def test_a_broken_package_is_named_and_ends_in_1(tmp_path: Path) -> None:
    (tmp_path / "h5py.py").write_text("raise ImportError('libhdf5.so: no such file')\n", encoding="utf-8")
    paths = os.pathsep.join((str(tmp_path), str(ROOT)))
    ended = run(
        [sys.executable, "-m", "labctl", "doctor"],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": paths},
    )
    assert ended.returncode == 1
    (line,) = [line for line in ended.stdout.splitlines() if " h5py " in line]
    assert "BROKEN" in line
    assert "libhdf5.so: no such file" in line
    assert "pip install" in line
    assert not ended.stderr
