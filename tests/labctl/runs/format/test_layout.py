from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

from labctl.runs.format.layout import RunPaths, run_name


def test_a_run_name_is_sortable_and_safe_on_every_file_system() -> None:
    started = datetime(2026, 11, 21, 10, 15, tzinfo=timezone(timedelta(hours=1)))
    name = run_name(started, "Image readout", "the request")
    assert name.startswith("20261121T091500Z-image-readout-")
    assert len(name.rsplit("-", 1)[1]) == 8
    assert ":" not in name
    assert name != run_name(started, "Image readout", "another request")
    assert run_name(datetime(2026, 1, 2, tzinfo=UTC), "...", "x").startswith("20260102T000000Z-run-")


def test_paths(tmp_path: Path) -> None:
    paths = RunPaths(tmp_path)
    assert paths.shard(12) == tmp_path / "shards" / "000012.h5"
    assert {paths.commands.name, paths.figures.name, paths.report.name} == {"commands.log", "figures", "report.html"}
