"""Status registers and error queues of both kinds of instrument."""

import pytest

from sim_backends.scpi.status import QUEUE_LENGTH, EventStatus, ScpiError, Status


@pytest.mark.parametrize(
    ("code", "bit"), [(-113, 0x20), (-222, 0x10), (-350, 0x08), (-410, 0x04), (2244, 0x10), (1008, 0x10)]
)
def test_event_bits(code: int, bit: int) -> None:
    status = Status()
    status.report(ScpiError(code))
    assert status.read_events() == bit
    assert status.read_events() == 0


def test_errors_are_read_in_order_and_removed() -> None:
    status = Status()
    status.report(ScpiError(-113, 'FOO "x"'))
    status.report(ScpiError(-222))
    assert status.count() == 2
    assert status.next_text() == "-113,\"Undefined header;FOO 'x'\""
    assert status.all_texts() == '-222,"Data out of range"'
    assert status.all_texts() == '0,"No error"'
    assert status.all_codes() == "0"


def test_a_full_queue_ends_in_overflow() -> None:
    status = Status()
    for _ in range(QUEUE_LENGTH + 5):
        status.report(ScpiError(-113))
    assert status.count() == QUEUE_LENGTH
    assert status.all_codes().split(",")[-2:] == ["-113", "-350"]


def test_status_byte() -> None:
    status = Status()
    assert status.byte() == 0
    assert status.byte(message_available=True) == 0x10
    status.report(ScpiError(-113))
    assert status.byte() == 0x04
    status.event_mask = 0x20
    assert status.byte() == 0x24
    status.service_mask = 0x20
    assert status.byte() == 0x64
    status.clear()
    assert status.byte() == 0
    assert (status.event_mask, status.service_mask) == (0x20, 0x20)


def test_events_are_read_after_the_register() -> None:
    status = EventStatus()
    status.report(ScpiError(-113, "FOO"))
    assert status.next_text() == '1,"No events to report - new events pending *ESR?"'
    assert status.count() == 0
    assert status.read_events() == 0x20
    assert status.count() == 1
    assert status.all_texts() == '113,"Undefined header; FOO"'
    assert status.all_texts() == '0,"No events to report - queue empty"'


def test_reading_the_register_replaces_events_released_before() -> None:
    status = EventStatus()
    status.report(ScpiError(-113))
    status.read_events()
    status.report(ScpiError(2244))
    status.read_events()
    assert status.all_codes() == "2244"


def test_masked_events_are_not_recorded() -> None:
    status = EventStatus()
    status.enabled = 0x10
    status.report(ScpiError(-113))
    status.complete()
    assert status.read_events() == 0
    status.enabled = 0xFF
    status.complete()
    assert status.read_events() == 1
    assert status.next_code() == 402
    status.report(ScpiError(-113))
    status.clear()
    assert status.read_events() == 0
    assert status.next_code() == 0


def test_errors_say_what_they_are() -> None:
    assert str(ScpiError(-222, "25")) == "-222: Data out of range (25)"
