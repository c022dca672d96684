"""`labctl verify` as it is typed."""

import json
from pathlib import Path
from typing import Any

import pytest

from labctl.commands.main import main


@pytest.fixture
def whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    settings = ("images=4", "window=0.8 ns", "ports=2")
    with pytest.raises(SystemExit):
        main(["run", "image-readout", *(f"--set={one}" for one in settings), "--out", str(tmp_path / "run")])
    capsys.readouterr()
    return tmp_path / "run"


def verify(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ended:
        main(["verify", *map(str, arguments)])
    return int(str(ended.value.code)), capsys.readouterr().out


def test_whole_incomplete_damaged_and_no_run(whole: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert verify(capsys, whole) == (0, f"{whole}: complete, intact: 6 of 6 shots in 1 shards\ndata.h5: current\n")
    status, out = verify(capsys, whole, "--json")
    found: dict[str, Any] = json.loads(out)
    assert (status, found["intact"], found["complete"], found["damaged"], found["problems"]) == (
        0,
        True,
        True,
        None,
        [],
    )
    (whole / "data.h5").write_bytes(b"")
    status, out = verify(capsys, whole)
    assert status == 1
    assert f"{whole}: DAMAGED: 6 of 6 shots" in out
    assert "first damaged: data.h5, bytes 0 to -1" not in out
    assert verify(capsys, whole, "--rebuild")[0] == 0
    shard = whole / "shards" / "000000.h5"
    image = bytearray(shard.read_bytes())
    image[1000] ^= 1
    shard.write_bytes(image)
    status, out = verify(capsys, whole, "--json")
    found = json.loads(out)
    assert (status, found["intact"]) == (1, False)
    assert found["damaged"] == {"file": "shards/000000.h5", "first": 1000, "last": 1000}
    assert "first damaged: shards/000000.h5, bytes 1000 to 1000" in verify(capsys, whole)[1]
    shard.unlink()
    assert "first damaged: shards/000000.h5 is missing" in verify(capsys, whole)[1]
    (whole / "journal.jsonl").write_bytes(b"")
    (whole / "data.h5").unlink()
    status, out = verify(capsys, whole, "--json")
    found = json.loads(out)
    assert (status, found["intact"], found["complete"], found["shots"]) == (0, True, False, 0)
    assert verify(capsys, tmp_path)[0] == 2
