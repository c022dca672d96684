"""What becomes of a reply on its way: pure functions of its bytes, the line feed at its end included."""

from collections.abc import Callable
from dataclasses import dataclass

from sim_backends.servers.channel import Chunk

BUFFER = 20 * 1024
"""Bytes that VISA clients commonly ask for at once."""
GARBAGE = b"\x00\x80\xfe\xff#\x07;:garbage,\xc3\x28"
SURPLUS = b"\x01\x02\x03"


@dataclass(frozen=True)
class Reply:
    """What comes in place of a reply: `pieces`, each in a packet of its own, and then perhaps the end of the link.

    `held` is late: it comes ahead of the next reply on the same link, if there is one.
    """

    pieces: tuple[Chunk, ...] = ()
    held: bytes = b""
    hangs_up: bool = False


Distortion = Callable[[bytes], Reply]


def intact(reply: bytes) -> Reply:
    """Nothing happens to it."""
    return Reply((reply,))


def instead(text: bytes) -> Distortion:
    """Another reply comes in its place."""
    return lambda _reply: Reply((text + b"\n",))


def lost_before(_reply: bytes) -> Reply:
    """The link ends before its first byte."""
    return Reply(hangs_up=True)


def lost_inside(reply: bytes) -> Reply:
    """The link ends in its middle."""
    return Reply((reply[: len(reply) // 2],), hangs_up=True)


def lost_after(reply: bytes) -> Reply:
    """The link ends behind its last byte."""
    return Reply((reply,), hangs_up=True)


def without_end(reply: bytes) -> Reply:
    """Its line feed is missing."""
    return Reply((reply[:-1],))


def late(reply: bytes) -> Reply:
    """It comes when the next one is due, ahead of it."""
    return Reply(held=reply)


def silent(_reply: bytes) -> Reply:
    """It does not come."""
    return Reply()


def twice(reply: bytes) -> Reply:
    """It comes twice."""
    return Reply((reply + reply,))


def empty(_reply: bytes) -> Reply:
    """Only its line feed comes."""
    return Reply((b"\n",))


def garbage(_reply: bytes) -> Reply:
    """Bytes come that no instrument says."""
    return Reply((GARBAGE + b"\n",))


def not_ascii(reply: bytes) -> Reply:
    """The upper bit of every byte but the last is set."""
    return Reply((bytes(byte | 0x80 for byte in reply[:-1]) + b"\n",))


def quoted_lines(_reply: bytes) -> Reply:
    """A quoted text with CR LF inside comes in its place, as error texts of some models have it."""
    return Reply((b'-300,"Device-specific error;\r\nsee the screen"\n',))


def with_header(reply: bytes) -> Reply:
    """A header comes with it, as after somebody switched headers on at the instrument."""
    return Reply((b":HEADER " + reply,))


def single_bytes(reply: bytes) -> Reply:
    """Each byte comes in a packet of its own."""
    return Reply(tuple(bytes((byte,)) for byte in reply))


def to_the_edge(reply: bytes) -> Reply:
    """It fills a buffer of the client to the last byte: text is padded with spaces; a block's last byte comes alone."""
    if reply.startswith(b"#"):
        return Reply((reply[:-1], reply[-1:]))
    return Reply((reply[:-1].ljust(BUFFER - 1) + b"\n",))


def longer_block(reply: bytes) -> Reply:
    """More bytes come than the block's header says."""
    return Reply((reply[:-1] + SURPLUS + b"\n",))


def shorter_block(reply: bytes) -> Reply:
    """Fewer bytes come than the block's header says."""
    return Reply((reply[: -1 - len(SURPLUS)] + b"\n",))


def ten_digits(reply: bytes) -> Reply:
    """The block's header is `#A`: its length in ten digits."""
    begin = 2 + int(reply[1:2])
    return Reply((b"#A%010d" % int(reply[2:begin]) + reply[begin:],))


def clipped(reply: bytes) -> Reply:
    """Every other sample of a block of bytes lies at the upper end of the digitiser."""
    begin = 2 + int(reply[1:2])
    samples = bytearray(reply[begin:-1])
    samples[::2] = b"\x7f" * len(samples[::2])
    return Reply((reply[:begin] + bytes(samples) + b"\n",))


def without_last_stamp(reply: bytes) -> Reply:
    """The last frame is missing in a list of frame numbers and time stamps."""
    return Reply((b",".join(reply[:-1].split(b",")[:-2]) + b"\n",))


def stamps_swapped(reply: bytes) -> Reply:
    """The second and the third frame have changed places in a list of frame numbers and time stamps."""
    one, first, two, second, three, third, *rest = reply[:-1].split(b",")
    return Reply((b",".join((one, first, two, third, three, second, *rest)) + b"\n",))
