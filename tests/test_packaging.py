"""The wheel and the source distribution hold everything: they work where there is no checkout."""

import os
import shutil
import sys
import tarfile
from pathlib import Path
from subprocess import run

import pytest

from tests.checkout import ROOT, files_below

PACKAGES = ("labctl", "instruments", "protocols", "sim_backends")


def files_of(*folders: str) -> set[str]:
    """Every file of some folders of the checkout that was not made there, by its path in it."""
    found = (path for folder in folders for path in files_below(ROOT / folder))
    return {path.relative_to(ROOT).as_posix() for path in found if path.suffix != ".pyc"}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-t", "sdist", "-d", str(folder)]
    run(command, check=True, capture_output=True, cwd=ROOT)
    return folder


@pytest.fixture(scope="module")
def installed(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel unpacked, which is all that installing it does besides the script."""
    folder = tmp_path_factory.mktemp("site")
    (wheel,) = built.glob("*.whl")
    shutil.unpack_archive(wheel, folder, "zip")
    return folder


def test_the_wheel_holds_every_file_of_the_packages_and_the_data(installed: Path) -> None:
    bundled = {path.replace("data/", "labctl/bundled/", 1) for path in files_of("data")}
    expected = files_of(*PACKAGES) | bundled
    assert {"protocols/experiments/fig3.toml", "instruments/alnair_tlg220.toml"} <= expected
    assert "labctl/reports/templates/base.html" in expected
    assert "labctl/bundled/mnist-0-3/0.bin" in bundled
    held = {path.relative_to(installed).as_posix() for path in installed.rglob("*") if path.is_file()}
    assert {path for path in held if ".dist-info/" not in path} == expected


def test_the_source_distribution_holds_what_builds_the_wheel_and_tests_it(built: Path) -> None:
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    needed = {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "Makefile", "requirements.lock"}
    assert needed | files_of(*PACKAGES, "data", "docs", "tests", "benchmarks") <= held


def test_it_measures_from_an_empty_directory_without_the_checkout(installed: Path, tmp_path: Path) -> None:
    """Protocols and drivers by their entry points, digits, laser table: all from what was installed."""
    program = (
        "import labctl, sys; from labctl.commands.main import main; sys.stderr.write(labctl.__file__ + '\\n');"
        "main(['run', 'image-readout', '--set', 'images=10', '--set', 'window=0.4 ns', '--out', 'run', '--json'])"
    )
    environment = {name: value for name, value in os.environ.items() if name != "LABCTL_DATA"}
    ended = run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=environment | {"PYTHONPATH": str(installed), "PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr.startswith(str(installed))
    assert (tmp_path / "run" / "data.h5").is_file()
