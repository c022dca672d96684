import json
from collections.abc import Callable
from pathlib import Path

from labctl.runs.catalogue import Catalogue
from labctl.runs.index import RunRow


def rows(folder: Path) -> list[RunRow]:
    return [found.row for found in Catalogue(folder).find(sort="name")]


def test_runs_are_listed_by_name(tmp_path: Path, write_whole: Callable[..., Path], cut: Path) -> None:
    write_whole(tmp_path / "20261121T091500Z-image-readout-1a2b3c4d")
    (tmp_path / "notes").mkdir()
    (tmp_path / "file").touch()
    first, second = rows(tmp_path)
    assert (first.name, first.protocol, first.seed, first.twin_seed) == (
        "20261121T091500Z-image-readout-1a2b3c4d",
        "image-readout",
        7,
        3,
    )
    assert (first.started, first.shots, first.planned, first.complete) == ("2026-11-21T09:15:00Z", 7, 7, True)
    assert (second.path, second.shots, second.planned, second.complete) == (cut, 3, 7, False)


def test_a_protocol_and_seeds_may_be_maps(cut: Path) -> None:
    values = json.loads((cut / "manifest.json").read_text())
    values |= {"protocol": {"name": "dynamic-scene"}, "seeds": {"seed": 4, "twin_seed": None}}
    (cut / "manifest.json").write_text(json.dumps(values))
    (row,) = rows(cut.parent)
    assert (row.protocol, row.seed, row.twin_seed) == ("dynamic-scene", 4, None)


def test_a_damaged_run_is_a_row_with_its_problem(cut: Path) -> None:
    (cut / "journal.jsonl").unlink()
    (row,) = rows(cut.parent)
    assert "journal.jsonl: cannot be read" in row.problem
    assert not row.complete


def test_what_was_wrong_with_a_run_is_forgotten_when_it_is_mended(whole: Path) -> None:
    link = whole / "shards" / "link"
    link.symlink_to("/etc/hostname")
    assert [row.problem for row in rows(whole.parent)] == [
        f"{link}: is a link to another place: put the file itself there"
    ]
    link.unlink()
    assert [(row.problem, row.state) for row in rows(whole.parent)] == [("", "complete")]


def test_no_folder_no_runs(tmp_path: Path) -> None:
    assert rows(tmp_path / "runs") == []


def test_a_listing_opens_no_data(tmp_path: Path, whole: Path) -> None:
    for path in (whole / "data.h5", whole / "plan.h5", *(whole / "shards").iterdir()):
        path.write_bytes(b"not HDF5")
    (found,) = rows(whole.parent)
    assert (found.shots, found.problem, found.state) == (7, "", "complete")
