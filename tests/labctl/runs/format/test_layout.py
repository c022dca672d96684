import json
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.format.layout import Manifest, RunPaths, check_version, run_name
from labctl.runs.format.shots import RunShape


def test_a_run_name_is_sortable_and_safe_on_every_file_system() -> None:
    started = datetime(2026, 11, 21, 10, 15, tzinfo=timezone(timedelta(hours=1)))
    name = run_name(started, "Image readout", "the request")
    assert name.startswith("20261121T091500Z-image-readout-")
    assert len(name.rsplit("-", 1)[1]) == 8
    assert ":" not in name
    assert name != run_name(started, "Image readout", "another request")
    assert run_name(datetime(2026, 1, 2, tzinfo=UTC), "...", "x").startswith("20260102T000000Z-run-")


@pytest.mark.parametrize("version", ["1.0", "1.7", "1.12"])
def test_later_minor_versions_are_read(version: str) -> None:
    check_version(version, Path("data.h5"))


@pytest.mark.parametrize("version", ["2.0", "0.9", "new", "", "\n.1", "9" * 5000 + ".1"])
def test_other_versions_are_refused_in_one_line(version: str) -> None:
    with pytest.raises(RunError, match=r"^data\.h5: format .*reads 1\.x") as refused:
        check_version(version, Path("data.h5"))
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 200


def test_a_manifest_of_a_later_minor_version_may_have_more_keys(tmp_path: Path, small: RunShape) -> None:
    values = {"format_version": "1.9", "shape": small.to_json() | {"colour": "blue"}, "new": 1}
    (tmp_path / "manifest.json").write_text(json.dumps(values))
    assert Manifest.read(RunPaths(tmp_path)).shape == small


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"format_version": "1.0"}', '{"format_version": "1.0", "shape": {}}']
)
def test_a_damaged_manifest_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(RunError, match=r"manifest\.json: damaged"):
        Manifest.read(RunPaths(tmp_path))


def test_a_manifest_that_is_no_text_is_named(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_bytes(b"\xff\xfe")
    with pytest.raises(RunError, match=r"manifest\.json: cannot be read"):
        Manifest.read(RunPaths(tmp_path))


def test_paths(tmp_path: Path) -> None:
    paths = RunPaths(tmp_path)
    assert paths.shard(12) == tmp_path / "shards" / "000012.h5"
    assert {paths.commands.name, paths.figures.name, paths.report.name} == {"commands.log", "figures", "report.html"}
