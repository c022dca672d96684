import json
from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.shape import RunShape


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
