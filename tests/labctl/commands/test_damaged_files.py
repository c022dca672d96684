"""Readouts, data files, manifests and settings that somebody changed: one line, and a result from none of them."""

import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from tests.damage import of_hdf5, of_json
from tests.data_sets import require
from tests.labctl.commands.conftest import Typed

ONE_IN = 6
"""Of the ways in which a file can be changed, one in so many is tried in a turn; the place moves on."""
TURNS = [turn if turn < 2 else pytest.param(turn, marks=pytest.mark.full) for turn in range(ONE_IN)]
"""The first two have every array and entry of a file, and every way to change one, several times each."""


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory, bench_run: Path) -> Path:
    """A run of its own, with a readout."""
    from labctl.studies.readout_training import train_readout

    directory = tmp_path_factory.mktemp("damaged") / "run"
    shutil.copytree(bench_run, directory)
    train_readout(directory, window_s=0.4e-9, ports=None, seed=1, out=directory / "models" / "softmax.h5")
    return directory


@pytest.fixture
def refused(typed: Typed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """The command: its status. One line on standard error unless it is 0, one JSON object, no file of details."""
    details = tmp_path / "details"
    details.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(details))

    def carry_out(what: str, *words: object) -> int:
        status, out, err = typed(*words, "--json")
        lines = err.splitlines()
        assert status in (0, 1, 2), what
        assert len(lines) <= 1, (what, err)
        assert all(line.startswith("labctl: ") for line in lines), (what, err)
        assert not list(details.iterdir()), (what, err)
        assert out.count("\n") == 1, (what, out)
        json.loads(out, parse_constant=pytest.fail)
        return status

    return carry_out


@pytest.mark.parametrize("turn", TURNS)
def test_a_readout_that_is_not_what_was_saved_gives_no_accuracy(
    measured: Path, refused: Callable[..., int], tmp_path: Path, turn: int
) -> None:
    saved, changed = measured / "models" / "softmax.h5", tmp_path / "changed.h5"
    with h5py.File(saved) as file:
        changes = [(name, change) for name, change in of_hdf5(file) if name != "/@sha256 missing"]
    for name, change in changes[turn::ONE_IN]:
        shutil.copy(saved, changed)
        with h5py.File(changed, "r+") as file:
            change(file)
        if not alike(saved, changed):
            assert refused(name, "evaluate", changed, measured) == 2, name


def alike(one: Path, other: Path) -> bool:
    """Whether two files hold the same arrays; the change of an attribute is always one."""
    found: list[dict[str, tuple[str, bytes]]] = []
    for path in (one, other):
        arrays: dict[str, tuple[str, bytes]] = {}
        with h5py.File(path) as file:
            file.visititems(
                lambda name, item, arrays=arrays: (
                    arrays.update({name: (f"{item.dtype} {item.shape}", item[()].tobytes())})
                    if isinstance(item, h5py.Dataset) and item.shape is not None
                    else arrays.update({name: ("", b"")})
                )
            )
            arrays |= {f"@{name}": ("", repr(value).encode()) for name, value in file.attrs.items()}
        found.append(arrays)
    return found[0] == found[1]


@pytest.mark.parametrize(
    "name", ["coef_ one not a number", "coef_ one shorter", "coef_ text", "intercept_ one longer", "classes_ missing"]
)
def test_a_readout_that_its_maker_calls_whole_must_be_sound(
    measured: Path, refused: Callable[..., int], tmp_path: Path, name: str
) -> None:
    """One without a digest, as earlier files are."""
    changed = tmp_path / "changed.h5"
    shutil.copy(measured / "models" / "softmax.h5", changed)
    with h5py.File(changed, "r+") as file:
        dict(of_hdf5(file))[f"softmaxregression/{name}"](file)
        del file.attrs["sha256"]
    assert refused(name, "evaluate", changed, measured) == 2


def test_a_readout_in_the_place_of_a_run_is_called_what_it_is(measured: Path, typed: Typed) -> None:
    saved = measured / "models" / "softmax.h5"
    for words in (("evaluate", saved, saved), ("export", saved, "--to", "npz"), ("compare", measured, saved)):
        status, _, told = typed(*words)
        assert (status, told) == (2, f"labctl: {saved}: is a readout, not a run: name a run directory\n"), words


@pytest.mark.parametrize("turn", TURNS)
def test_a_changed_data_file_is_read_or_refused(
    measured: Path, refused: Callable[..., int], tmp_path: Path, turn: int
) -> None:
    directory = tmp_path / "run"
    shutil.copytree(measured, directory)
    with h5py.File(measured / "data.h5") as file:
        changes = [(name, change) for name, change in of_hdf5(file) if "@" not in name]
    for name, change in changes[turn::ONE_IN]:
        shutil.copy(measured / "data.h5", directory / "data.h5")
        with h5py.File(directory / "data.h5", "r+") as file:
            change(file)
        refused(name, "verify", directory)
        refused(name, "train", directory, "--out", tmp_path / "readout.h5")


@pytest.mark.parametrize("turn", TURNS)
def test_a_changed_manifest_is_read_or_refused(
    measured: Path, refused: Callable[..., int], tmp_path: Path, turn: int
) -> None:
    directory = tmp_path / "run"
    shutil.copytree(measured, directory)
    manifest = json.loads((measured / "manifest.json").read_text("utf-8"))
    named = {name: manifest[name] for name in ("format_version", "shape", "durability", "plan_sha256", "protocol")}
    for name, text in list(of_json(named))[turn::ONE_IN]:
        (directory / "manifest.json").write_text(json.dumps(manifest | json.loads(text)), encoding="utf-8")
        refused(name, "verify", directory)
        refused(name, "runs", directory.parent)
        refused(name, "resume", directory)


@pytest.mark.parametrize(
    ("protocol", "setting"),
    [
        ("image-readout", "window=1e9 s"),
        ("image-readout", "window=1e-30 s"),
        ("image-readout", "window=0.5 ns"),
        ("image-readout", "averages=1000000000000"),
        ("image-readout", "seed=99999999999999999999"),
        ("image-readout", "reference_every=99999999999999999999"),
        ("image-readout", "wavelengths=1e9 nm"),
        ("image-readout", "wavelengths=1700 nm"),
        ("image-readout", "classes=1,1"),
        ("dynamic-scene", "window=1e-30 s"),
        ("dynamic-scene", "averages=300"),
        ("wavelength-scan", "window=1e9 s"),
        ("wavelength-scan", "start=1e9 m"),
        ("wavelength-scan", "step=1e-9 nm"),
        ("wavelength-scan", "step=1e308 nm"),
        ("sequence-readout", "symbols=99999999999999999999"),
    ],
)
def test_a_setting_that_no_run_can_have_is_refused_by_a_dry_run(
    refused: Callable[..., int], protocol: str, setting: str
) -> None:
    if protocol == "sequence-readout":
        require("santa-fe")
    assert refused(setting, "run", protocol, "--set", setting, "--dry-run") == 2
