"""A run that is given away: whole, checked by others' tools, and never without what is wrong with it."""

import json
import shutil
import subprocess
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from instruments.values import Drive
from labctl.errors import LabctlError, RunError, UsageError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.shape import RunShape
from labctl.runs.notes import say_of
from labctl.runs.publication import FORMATS, Declaration, Person, declared, publish
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter
from tests.command_line import labctl as typed

SAID = declared(
    title="Digits", creators=["Ada Lovelace <0000-0002-1825-0097>"], licence="CC-BY-4.0", publisher="A university"
)
DAY = date(2026, 11, 23)


def described(folder: Path, to: str) -> tuple[str, str]:
    """Title and description of what was published."""
    found: Any = json.loads((folder / FORMATS[to][0]).read_text("utf-8"))
    if to == "datacite":
        return found["titles"][0]["title"], found["descriptions"][0]["description"]
    (root,) = (one for one in found["@graph"] if one["@id"] == "./")
    return root["name"], root["description"]


@pytest.fixture
def real(
    tmp_path: Path, small: RunShape, plan_for: Callable[[RunShape], Any], measure_missing: Callable[..., None]
) -> Path:
    """A run that says nothing of a simulated bench."""
    identity = {"manufacturer": "TEKTRONIX", "model": "AWG70002A", "serial": "B030112", "firmware": "7.2"}
    manifest = {
        "protocol": {"name": "image-readout", "settings": {"images": 7}},
        "started": "2026-11-21T09:15:00+00:00",
        "seeds": {"seed": 7, "twin_seed": None},
        "instruments": {"awg": {"identity": identity}},
        "versions": {"photonic-labctl": "0.1.0"},
    }
    drive = Drive("ramp", np.linspace(-1, 1, 50, dtype=np.float32), 25e9, 0.4)
    durability = Durability(shots=3, seconds=3600)
    with RunWriter.create(tmp_path / "real", manifest, small, plan_for(small), drive, durability) as writer:
        measure_missing(writer, small)
    return tmp_path / "real"


@pytest.mark.parametrize("to", FORMATS)
def test_what_is_published_is_the_run_with_checksums_that_others_check(to: str, real: Path, tmp_path: Path) -> None:
    say_of(RunPaths(real), "fibre touched at noon", tags=["good"], operator="Ada")
    of_others = [real / name for name in ("control", "glimpse", "looked")]
    for path in of_others:
        path.write_text("stop\n")
    out = tmp_path / "given"
    subject = publish(real, out, to, SAID, DAY)
    assert subject.faults == []
    assert described(out, to)[0] == "Digits"
    assert not any((out / path.name).exists() for path in of_others)
    sums = ["sha256sum", "--check", "--strict", "--quiet", "SHA256SUMS"]
    assert subprocess.run(sums, cwd=out, check=False, capture_output=True).returncode == 0
    listed = {line.partition("  ")[2] for line in (out / "SHA256SUMS").read_text("utf-8").splitlines()}
    there = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert listed == there - {"SHA256SUMS"}
    assert verify_run(out).intact
    with open_run(out) as copy, open_run(real) as run:
        assert copy.digest() == run.digest()
    text = (out / FORMATS[to][0]).read_text("utf-8")
    for known in (
        "image-readout",
        "AWG70002A",
        "B030112",
        "0.1.0",
        "fibre touched",
        "2026-11-21T09:15:00",
        "CC-BY-4.0",
    ):
        assert known in text
    (out / "data.h5").write_bytes(b"changed")
    assert subprocess.run(sums, cwd=out, check=False, capture_output=True).returncode == 1


@pytest.mark.parametrize("to", FORMATS)
def test_what_is_wrong_with_a_run_comes_first_in_title_and_description(to: str, cut: Path, tmp_path: Path) -> None:
    """Simulated, cut short and damaged."""
    shard = cut / "shards" / "000000.h5"
    shard.write_bytes(shard.read_bytes()[:-1])
    subject = publish(cut, tmp_path / "given", to, SAID, DAY)
    title, description = described(tmp_path / "given", to)
    assert title == "[SIMULATED] [DAMAGED] [UNFINISHED] Digits"
    assert description.startswith(
        "SIMULATED: made by the simulated bench of labctl, not measured on real instruments. "
    )
    assert "000000.h5" in description
    assert "of 7 shots are there and intact" in description
    assert len(subject.faults) == 3


ALP = {"manufacturer": "ViALUX", "model": "ALP-4 1024x768", "serial": "13388", "firmware": "3"}
SERVED_ALP = {
    "station": {"dmd": {"driver": "vialux-alp", "address": "TCPIP0::127.0.0.1::5003::SOCKET"}},
    "instruments": {"dmd": {"identity": ALP}},
}
OTHER_MAKER = {"manufacturer": "SIMTRUM", "model": "L1", "serial": "1", "firmware": "1"}


@pytest.mark.parametrize(
    ("changes", "mark", "kind"),
    [
        ({"instruments": {"awg": {"identity": {"serial": "SIM0001"}}}}, "[SIMULATED] ", "Simulated measurement"),
        (SERVED_ALP, "[PARTLY SIMULATED] ", "Partly simulated measurement"),
        ({"replay": [{"name": "a.rec", "sha256": "0" * 64}]}, "[REPLAYED] ", "Replayed measurement"),
        ({"instruments": {"laser": {"identity": OTHER_MAKER}}}, "", "Measurement"),
    ],
    ids=["served", "in part", "replayed", "a maker with such a name"],
)
def test_what_is_not_of_a_real_bench_is_marked(
    changes: dict[str, Any], mark: str, kind: str, real: Path, tmp_path: Path
) -> None:
    manifest = json.loads((real / "manifest.json").read_text("utf-8"))
    for name, change in changes.items():
        manifest[name] = manifest.get(name, {}) | change if isinstance(change, dict) else change
    (real / "manifest.json").write_text(json.dumps(manifest), "utf-8")  # which damages the run
    publish(real, tmp_path / "given", "datacite", SAID, DAY)
    title, description = described(tmp_path / "given", "datacite")
    found = json.loads((tmp_path / "given" / "datacite.json").read_text("utf-8"))
    assert (title, found["types"]["resourceType"]) == (
        f"{mark}[DAMAGED] [UNFINISHED] Digits",
        f"{kind}, image-readout",
    )
    assert description.startswith(f"{mark.strip('[] ') or 'DAMAGED'}: ")


def test_a_file_of_any_name_has_a_place_in_a_crate(real: Path, tmp_path: Path) -> None:
    (real / "models").mkdir()
    (real / "models" / "my model #1 100%.h5").write_bytes(b"of no matter")
    publish(real, tmp_path / "out", "ro-crate", SAID, DAY)
    graph = json.loads((tmp_path / "out" / "ro-crate-metadata.json").read_text("utf-8"))["@graph"]
    place = "models/my%20model%20%231%20100%25.h5"
    (file,) = (one for one in graph if one["@id"] == place)
    assert file["name"] == "models/my model #1 100%.h5"
    (root,) = (one for one in graph if one["@id"] == "./")
    assert {"@id": place} in root["hasPart"]


def test_every_file_of_a_crate_is_described(real: Path, tmp_path: Path) -> None:
    publish(real, tmp_path / "given", "ro-crate", SAID, DAY)
    graph = json.loads((tmp_path / "given" / "ro-crate-metadata.json").read_text("utf-8"))["@graph"]
    files = {one["@id"]: one for one in graph if one["@type"] == "File"}
    lines = (tmp_path / "given" / "SHA256SUMS").read_text("utf-8").splitlines()
    digests = {line.partition("  ")[2]: line.partition("  ")[0] for line in lines}
    assert {name: one["sha256"] for name, one in files.items()} | {
        "ro-crate-metadata.json": digests["ro-crate-metadata.json"]
    } == digests
    assert {one["@id"] for one in graph} >= {"./", "https://orcid.org/0000-0002-1825-0097", "#awg", "#labctl"}


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"title": ""}, "--title"),
        ({"creators": []}, "--creator"),
        ({"licence": " "}, "--licence"),
        ({"licence": "do what you like"}, "SPDX"),
        ({"licence": "foo"}, "SPDX"),
        ({"licence": "LicenseRef-foo"}, "SPDX"),
        ({"licence": "MIT+"}, "SPDX"),
        ({"creators": ["Ada <0000-0002-1825-0098>"]}, "ORCID"),
        ({"title": "x" * 501}, "500 characters"),
    ],
)
def test_what_only_a_person_can_say_is_asked_for(said: dict[str, Any], words: str) -> None:
    whole: dict[str, Any] = {"title": "Digits", "creators": ["Ada"], "licence": "CC-BY-4.0"}
    with pytest.raises(UsageError, match=words) as refused:
        declared(**whole | said)
    assert "\n" not in str(refused.value)


def test_names_with_and_without_an_orcid() -> None:
    found = declared(
        title="x", creators=["Ada  Lovelace", "J. Carberry <https://orcid.org/0000-0002-1825-0097>"], licence="MIT"
    )
    assert found.creators == (Person("Ada Lovelace"), Person("J. Carberry", "0000-0002-1825-0097"))


def test_a_licence_is_spelt_as_its_address_is() -> None:
    found = declared(title="x", creators=["Ada"], licence="cc-by-4.0")
    assert (found.licence, found.licence_url) == ("CC-BY-4.0", "https://spdx.org/licenses/CC-BY-4.0")


def test_datacite_needs_a_publisher_and_nothing_is_made_before(real: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--publisher"):
        publish(real, tmp_path / "given", "datacite", Declaration("x", (Person("Ada"),), "MIT"), DAY)
    assert [path.name for path in tmp_path.iterdir()] == ["real"]


def test_nothing_is_overwritten_and_only_runs_are_published(real: Path, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="exists"):
        publish(real, tmp_path, "ro-crate", SAID, DAY)
    with pytest.raises(RunError, match="in the run itself"):
        publish(real, real / "given", "ro-crate", SAID, DAY)
    with pytest.raises(RunError, match="not a run directory"):
        publish(tmp_path / "none", tmp_path / "given", "ro-crate", SAID, DAY)
    (real / "extra").symlink_to("/etc/hostname")
    with pytest.raises(LabctlError, match="is a link"):
        publish(real, tmp_path / "given", "ro-crate", SAID, DAY)


def test_what_does_not_fit_is_refused_with_options_that_there_are(real: Path, tmp_path: Path) -> None:
    with (real / "huge").open("wb") as file:
        file.truncate(shutil.disk_usage(tmp_path).total + 10**9)
    with pytest.raises(RunError, match=r"GB are free: make room, or name another place by --out$"):
        publish(real, tmp_path / "given", "ro-crate", SAID, DAY)
    assert [path.name for path in tmp_path.iterdir()] == ["real"]


def test_as_it_is_typed(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("publish", whole, "--as", "ro-crate", "--out", tmp_path / "given")
    status, out, err = typed(capsys, *words)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "--title and --creator and --licence: only you can say that" in err
    status, out, err = typed(capsys, *words, "--title", "Digits", "--creator", "Ada", "--licence", "CC0-1.0")
    assert (status, out) == (0, f"{tmp_path / 'given'}: [SIMULATED] Digits\n")
    assert "SIMULATED" in err
    shutil.rmtree(tmp_path / "given")
