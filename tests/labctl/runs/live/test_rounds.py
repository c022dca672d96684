"""commands.log grows with what happens: a round that has been there before is referred to, and no block is lost."""

import re
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from labctl.runs.live.logs import LONGEST_REPLY, MOST_IN_A_LINE, CommandLog

ROUND = re.compile(r"[\d.]+ = run (\d+) times since ([\d.]+) the (\d+) messages of ([\d.]+): (.*)")


@pytest.fixture
def log(tmp_path: Path) -> Iterator[CommandLog]:
    ticks = count()
    with CommandLog(clock=lambda: next(ticks) / 1000) as log:
        log.keep_in(tmp_path / "commands.log")
        yield log


def shot(log: CommandLog, picture: int, record: int, offset: str = "0", *, polls: int = 1) -> None:
    log("dmd", ">", f"ALP:SEQPUT 1,0,1,#<98304 bytes, crc32 {picture:08x}>")
    log("dmd", "<", "0")
    log("scope", ">", "ACQuire:STATE RUN")
    for last in range(polls):
        log("scope", ">", "TRIGger:A:READY?")
        log("scope", "<", str(int(last == polls - 1)))
    log("scope", ">", "CURVe?")
    log("scope", "<", f"CH1;{offset};#<50 bytes, crc32 {record:08x}>")
    log.acquired()


def lines(log: CommandLog, tmp_path: Path) -> list[str]:
    with log:
        pass
    return (tmp_path / "commands.log").read_text().splitlines()


def test_shots_that_are_alike_are_one_line_with_every_digest(log: CommandLog, tmp_path: Path) -> None:
    for number in range(1, 5):
        shot(log, number, 16 * number)
    first, again = lines(log, tmp_path)[:7], lines(log, tmp_path)[7:]
    assert [line.split(" ", 1)[1] for line in first[:2]] == [
        "> dmd ALP:SEQPUT 1,0,1,#<98304 bytes, crc32 00000001>",
        "< dmd 0",
    ]
    (line,) = again
    found = ROUND.fullmatch(line)
    assert found is not None
    assert found.groups()[::2] == ("3", "7", "00000002 00000020; 00000003 00000030; 00000004 00000040")
    assert found[4] == first[0].split()[0], "where the round is that is meant"


def test_a_log_of_many_shots_is_short(log: CommandLog, tmp_path: Path) -> None:
    for number in range(1000):
        shot(log, number, number)
    found = lines(log, tmp_path)
    assert len(found) <= 7 + 1000 / MOST_IN_A_LINE + 1
    assert sum(map(len, found)) < 30 * 1000


def test_what_is_another_message_is_written_as_it_is(log: CommandLog, tmp_path: Path) -> None:
    shot(log, 1, 1)
    log("scope", ">", "CH1:SCAle 0.1")
    shot(log, 2, 2)
    log("scope", ">", "CH1:SCAle 0.2")
    shot(log, 3, 3)
    *_, other, line = lines(log, tmp_path)
    assert other.endswith("> scope CH1:SCAle 0.2")
    assert "run 1 times" in line


def test_the_last_line_of_a_setting_is_what_was_set_last(log: CommandLog, tmp_path: Path) -> None:
    for scale in ("0.1", "0.2", "0.1", "0.1"):
        log("scope", ">", f"CH1:SCAle {scale}")
        shot(log, 1, 1)
    settings = [line.split()[-1] for line in lines(log, tmp_path) if "CH1:SCAle" in line]
    assert settings == ["0.1", "0.2", "0.1"]


def test_a_round_that_differs_in_much_is_written_as_it_is(log: CommandLog, tmp_path: Path) -> None:
    for first in (1, 2):
        for place in range(6):
            log("awg", ">", f"SOURce1:VOLTage {first}{place}")
        log.acquired()
    assert [line.split(" ", 1)[1] for line in lines(log, tmp_path)[6:]] == [
        f"> awg SOURce1:VOLTage 2{place}" for place in range(6)
    ]


def test_what_is_answered_beside_a_block_stands_before_its_digest(log: CommandLog, tmp_path: Path) -> None:
    shot(log, 1, 1, "1.0E-12")
    shot(log, 2, 2, "2.5E-12")
    assert lines(log, tmp_path)[-1].endswith(": 00000002 2.5E-12;00000002")


def test_another_length_of_a_block_is_another_round(log: CommandLog, tmp_path: Path) -> None:
    shot(log, 1, 1)
    log("scope", "<", "#<50 bytes, crc32 00000001>")
    log.acquired()
    log("scope", "<", "#<51 bytes, crc32 00000002>")
    log.acquired()
    assert lines(log, tmp_path)[-1].endswith("< scope #<51 bytes, crc32 00000002>")


def test_how_often_it_was_asked_makes_no_other_round(log: CommandLog, tmp_path: Path) -> None:
    shot(log, 1, 1, polls=3)
    shot(log, 2, 2, polls=9)
    found = lines(log, tmp_path)
    assert len(found) == 7 + 4 + 1
    assert "the 7 messages" in found[-1]


def test_what_was_said_before_something_went_wrong_is_there_word_for_word(log: CommandLog, tmp_path: Path) -> None:
    for number in range(3):
        shot(log, number, number)
    log("scope", ">", "ACQuire:STATE RUN")
    log.warning("no trigger came")
    texts = [line.split(" ", 1)[1] for line in (tmp_path / "commands.log").read_text().splitlines()]
    assert texts[-3].startswith("= run 2 times")
    assert texts[-2:] == ["> scope ACQuire:STATE RUN", "! run no trigger came"]


def test_a_long_list_is_its_beginning_and_a_digest(log: CommandLog, tmp_path: Path) -> None:
    for size in (LONGEST_REPLY, LONGEST_REPLY + 1):
        log("scope", "<", "1" * size)
    short, long = lines(log, tmp_path)
    assert short.endswith("1" * LONGEST_REPLY)
    assert re.fullmatch(r"[\d.]+ < scope 1{64}#<2049 bytes, crc32 [0-9a-f]{8}>", long)
