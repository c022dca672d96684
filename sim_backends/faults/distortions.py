"""What becomes of a reply on its way: pure functions of its bytes, the line feed at its end included."""

import re
from collections.abc import Callable

from sim_backends.servers.disturbed import Disturbed

BUFFER = 20 * 1024
"""Bytes that VISA clients commonly ask for at once."""
GARBAGE = b"\x00\x80\xfe\xff#\x07;:garbage,\xc3\x28"
SURPLUS = b"\x01\x02\x03"
_NUMBER = re.compile(rb"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")


Distortion = Callable[[bytes], Disturbed]


def intact(reply: bytes) -> Disturbed:
    """Nothing happens to it."""
    return Disturbed(reply)


def instead(text: bytes) -> Distortion:
    """Another reply comes in its place."""
    return lambda _reply: Disturbed(text + b"\n")


def lost_before(reply: bytes) -> Disturbed:
    """The link ends before its first byte."""
    return Disturbed(reply, ends_after=0)


def lost_inside(reply: bytes) -> Disturbed:
    """The link ends in its middle."""
    return Disturbed(reply, ends_after=len(reply) // 2)


def lost_after(reply: bytes) -> Disturbed:
    """The link ends behind its last byte."""
    return Disturbed(reply, ends_after=len(reply))


def without_end(reply: bytes) -> Disturbed:
    """Its line feed is missing, and so is the transport's own mark of its end."""
    return Disturbed(reply[:-1], ends=False)


def late(reply: bytes) -> Disturbed:
    """It comes when the next one is due, ahead of it."""
    return Disturbed(reply, late=True)


def silent(_reply: bytes) -> Disturbed:
    """It does not come."""
    return Disturbed()


def twice(reply: bytes) -> Disturbed:
    """It comes twice."""
    return Disturbed(reply + reply)


def empty(_reply: bytes) -> Disturbed:
    """Only its line feed comes."""
    return Disturbed(b"\n")


def garbage(_reply: bytes) -> Disturbed:
    """Bytes come that no instrument says."""
    return Disturbed(GARBAGE + b"\n")


def garbage_behind(reply: bytes) -> Disturbed:
    """Bytes come behind it that no instrument says."""
    return Disturbed(reply[:-1] + GARBAGE + b"\n")


def not_ascii(reply: bytes) -> Disturbed:
    """The upper bit of every byte but the last is set."""
    return Disturbed(bytes(byte | 0x80 for byte in reply[:-1]) + b"\n")


def quoted_lines(_reply: bytes) -> Disturbed:
    """A quoted text with CR LF inside comes in its place, as error texts of some models have it."""
    return Disturbed(b'-300,"Device-specific error;\r\nsee the screen"\n')


def with_header(reply: bytes) -> Disturbed:
    """A header comes with it, as after somebody switched headers on at the instrument."""
    return Disturbed(b":HEADER " + reply)


def single_bytes(reply: bytes) -> Disturbed:
    """Each byte comes in a packet of its own."""
    return Disturbed(reply, packet=1)


def to_the_edge(reply: bytes) -> Disturbed:
    """It fills a buffer of the client to the last byte: text is padded with spaces; a block's last byte comes alone."""
    if _data_begin(reply) is not None:
        return Disturbed(reply, packet=len(reply) - 1)
    return Disturbed(reply[:-1].ljust(BUFFER - 1) + b"\n")


def longer_block(reply: bytes) -> Disturbed:
    """More bytes come than the block's header says."""
    return Disturbed(reply[:-1] + SURPLUS + b"\n")


def shorter_block(reply: bytes) -> Disturbed:
    """Fewer bytes come than the block's header says."""
    return Disturbed(reply[: -1 - len(SURPLUS)] + b"\n")


def ten_digits(reply: bytes) -> Disturbed:
    """The block's header is `#A`: its length in ten digits."""
    head, begin = reply.find(b"#"), _data_begin(reply)
    if begin is None:
        return Disturbed(reply)
    return Disturbed(reply[:head] + b"#A%010d" % int(reply[head + 2 : begin]) + reply[begin:])


def clipped(reply: bytes) -> Disturbed:
    """Every other sample of a block of bytes lies at the upper end of the digitiser."""
    begin = _data_begin(reply)
    if begin is None:
        return Disturbed(reply)
    samples = bytearray(reply[begin:-1])
    samples[::2] = b"\x7f" * len(samples[::2])
    return Disturbed(reply[:begin] + bytes(samples) + b"\n")


def without_last_stamp(reply: bytes) -> Disturbed:
    """The last frame is missing in a list of frame numbers and time stamps."""
    return Disturbed(b",".join(reply[:-1].split(b",")[:-1]) + b"\n")


def stamps_swapped(reply: bytes) -> Disturbed:
    """The second and the third frame have changed their times in a list of frame numbers and time stamps."""
    items = [item.split(b": ") for item in reply[:-1].split(b",")]
    if len(items) >= 3:
        items[1][-1], items[2][-1] = items[2][-1], items[1][-1]
    return Disturbed(b",".join(b": ".join(item) for item in items) + b"\n")


def underscored(reply: bytes) -> Disturbed:
    """In place of the first number of a text comes one with an underscore, as no instrument writes it."""
    return Disturbed(reply if reply.startswith(b"#") else _NUMBER.sub(b"1_0", reply, count=1))


def wrong_number(reply: bytes) -> Disturbed:
    """The transport says that it answers a message that was sent before."""
    return Disturbed(reply, numbered=-2)


def number_ahead(reply: bytes) -> Disturbed:
    """The transport says that it answers a message that was not sent yet."""
    return Disturbed(reply, numbered=2)


def announced_longer(reply: bytes) -> Disturbed:
    """The transport announces more bytes than come."""
    return Disturbed(reply, announced=len(SURPLUS) + 1)


def announced_shorter(reply: bytes) -> Disturbed:
    """The transport announces fewer bytes than come."""
    return Disturbed(reply, announced=-4)


def in_fragments(reply: bytes) -> Disturbed:
    """The transport cuts it into three frames."""
    return Disturbed(reply, fragments=3)


def transport_error(code: int) -> Distortion:
    """The transport's own error comes in its place."""
    return lambda reply: Disturbed(reply, error=code)


def ending_after(count: int) -> Distortion:
    """The link ends behind its first `count` bytes."""
    return lambda reply: Disturbed(reply, ends_after=min(count, len(reply)))


def _data_begin(reply: bytes) -> int | None:
    """Where the data of a definite-length block begin, which other answers may precede; None: there is none."""
    head = reply.find(b"#")
    digits = reply[head + 1 : head + 2]
    return head + 2 + int(digits) if head >= 0 and digits.isdigit() and digits != b"0" else None
