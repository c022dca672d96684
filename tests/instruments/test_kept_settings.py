"""Settings are compared with what was answered when they were set, all in one message."""

from collections.abc import Iterator
from contextlib import nullcontext

import pytest

from instruments.errors import InstrumentError
from instruments.kept_settings import KeptSettings, Setting
from instruments.values import Change
from instruments.visa import VisaLink, tektronix_event_queue
from sim_backends.bench import SimulatedBench

RATE = Setting("HORizontal:MODE:SAMPLERate", "2.5E10", 1.0, "S/s")
MODE = Setting("ACQuire:MODe", "SAMple")
HEADER = Setting("HEADer", "OFF")


@pytest.fixture
def link() -> Iterator[VisaLink]:
    with SimulatedBench() as bench:
        scope = VisaLink(
            bench.resources["scope"]["socket"],
            name="scope",
            timeout_s=5,
            transcript=lambda *_: None,
            error_queue=tektronix_event_queue,
        )
        for setting in (RATE, MODE, HEADER):
            scope.write(setting.message)
        yield scope
        scope.close()


def test_what_was_changed_is_named_with_both_values(link: VisaLink) -> None:
    kept = KeptSettings(link)
    assert kept.changes() == ()
    assert kept.confirm((RATE, MODE, HEADER)) == ("2.5000000000E+10", "SAMPLE", "0")
    assert kept.changes() == ()
    link.write("ACQuire:MODe HIRes")
    assert kept.changes() == (Change("ACQuire:MODe", "SAMPLE", "HIRES"),)
    kept.forget([MODE.question])
    assert kept.changes() == ()


def test_a_setting_that_did_not_take_is_refused(link: VisaLink) -> None:
    link.write("ACQuire:MODe HIRes")
    with pytest.raises(InstrumentError, match=r"^scope: ACQuire:MODe: asked for SAMple, got 'HIRES': choose a value"):
        KeptSettings(link).confirm((RATE, MODE))


def test_what_a_refused_group_has_set_is_nobody_elses_change(link: VisaLink) -> None:
    kept = KeptSettings(link)
    kept.keep(["ACQuire:STOPAfter?", MODE.question])
    with pytest.raises(InstrumentError, match="memory holds"):
        kept.set(
            (
                Setting("ACQuire:MODe", "HIRes"),
                Setting("HORizontal:FASTframe:STATE", "ON"),
                Setting("HORizontal:FASTframe:COUNt", "100000000"),
            )
        )
    assert kept.changes() == ()
    link.write("ACQuire:STOPAfter SEQuence")
    assert [change.setting for change in kept.changes()] == ["ACQuire:STOPAfter"]


@pytest.mark.parametrize(("answer", "taken"), [("49", False), ("50", True), ("500", True), ("1051", False)])
def test_an_instrument_may_give_more_of_its_own_accord(answer: str, taken: bool) -> None:
    length = Setting("HORizontal:MODE:RECOrdlength", "50", unit="samples", surplus=1000)
    with (
        nullcontext() if taken else pytest.raises(InstrumentError, match=f"asked for 50 samples, got {answer} samples")
    ):
        length.check("scope", answer)


@pytest.mark.parametrize("answer", ["SAMPLE", "SAM", "sam"])
def test_words_come_back_in_their_long_or_short_form(answer: str) -> None:
    MODE.check("scope", answer)
    Setting("CH1:INVert", "OFF").check("scope", "0")
    with pytest.raises(InstrumentError, match="asked for SAMple"):
        MODE.check("scope", "SA")


def test_one_of_several_is_asked_for_by_its_name() -> None:
    level = Setting("TRIGger:LEVel", "1.4", 0.05, "V", target="ATRigger")
    assert (level.message, level.question) == ("TRIGger:LEVel 1.4,ATRigger", "TRIGger:LEVel? ATRigger")
