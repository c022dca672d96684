"""Whose bench a command would open is looked up before the command is loaded."""

from pathlib import Path

import pytest

from labctl.bench.lock import held
from labctl.bench.recording.wire import VARIABLE
from labctl.bench.station import read_station
from labctl.commands.refusal import refuse_bench_in_use
from labctl.errors import BenchInUse

STATION = '[laser]\narmed = false\n[awg]\naddress = "TCPIP::192.0.2.7::INSTR"\n'


@pytest.fixture
def station(tmp_path: Path) -> Path:
    path = tmp_path / "bench.toml"
    path.write_text(STATION, encoding="utf-8")
    return path


@pytest.mark.parametrize("command", ["align", "check", "live", "reproduce", "run", "sweep"])
@pytest.mark.parametrize("option", ["--station={}", "--station {}"])
def test_a_bench_that_somebody_has(station: Path, command: str, option: str) -> None:
    words = [command, *option.format(station).split(" ")]
    refuse_bench_in_use(words)
    with held(read_station(station), "labctl align"), pytest.raises(BenchInUse, match=r"^awg is in use: labctl align"):
        refuse_bench_in_use(words)


@pytest.mark.parametrize(
    "words", [["run", "--dry-run"], ["check", "--help"], ["dashboard"], ["queue", "add", "run"], ["show"]]
)
def test_who_only_looks_is_let_in(station: Path, words: list[str]) -> None:
    with held(read_station(station), "labctl align"):
        refuse_bench_in_use([*words, f"--station={station}"])


def test_a_recording_is_played_whoever_has_the_bench(station: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, '{"replay": {}}')
    with held(read_station(station), "labctl align"):
        refuse_bench_in_use(["check", f"--station={station}"])


@pytest.mark.parametrize("content", [b"", b"[awg", b"awg = 3", b"[awg]\naddress = 3", b"\xff", b"x = [" * 5000])
def test_what_is_wrong_with_a_station_is_left_to_the_command(station: Path, content: bytes) -> None:
    station.write_bytes(content)
    refuse_bench_in_use(["check", f"--station={station}"])
    refuse_bench_in_use(["check", f"--station={station.with_name('missing')}"])
    refuse_bench_in_use(["check", "--station"])
