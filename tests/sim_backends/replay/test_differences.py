"""How differences are told."""

from hypothesis import given
from hypothesis import strategies as st

from sim_backends.replay.differences import describe, first_difference


@given(block=st.binary(min_size=1, max_size=300), at=st.integers(0), flip=st.integers(1, 255))
def test_the_first_differing_byte_of_any_block(block: bytes, at: int, flip: int) -> None:
    at %= len(block)
    changed = bytearray(block)
    changed[at] ^= flip
    head = f"PUT 1,#{len(str(len(block)))}{len(block)}".encode()
    told = first_difference(head + block + b"\n", head + bytes(changed) + b"\n")
    assert told == f"; first differing byte of the block {at}: {block[at]:#04x} expected, {changed[at]:#04x} sent"


@given(message=st.binary(max_size=400))
def test_any_message_is_described_in_one_line(message: bytes) -> None:
    assert "\n" not in describe(message)
