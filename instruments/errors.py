"""How instruments fail: every message is one line that says what, where and what to do."""

from typing import ClassVar

EXCERPT = 40
"""Characters of a wrong reply that a message shows."""


def excerpt(reply: str | bytes | bytearray) -> str:
    """A wrong reply as a message shows it: its beginning, in one line."""
    return repr(reply[:EXCERPT] if isinstance(reply, str) else bytes(reply[:EXCERPT]))


class LabctlError(Exception):
    """What a person can meet and mend: the message is one line that says what happened, where, and what to do.

    Attributes:
        exit_status: What a command ends in: 2 where what was asked for is wrong, 1 where an instrument failed.
    """

    exit_status: ClassVar[int] = 2


class InstrumentError(LabctlError):
    """An instrument refused, failed or did not answer."""

    exit_status: ClassVar[int] = 1


class LinkError(InstrumentError):
    """The instrument cannot be reached, or did not answer in time.

    Attributes:
        silent: nothing at all came over a link that had just been opened: another new one would be of no use.
        resource: the VISA address that was spoken to; empty for what is at none.
    """

    silent: bool = False
    resource: str = ""


class InstrumentInUse(InstrumentError):
    """Another program has the instrument for itself, by the instrument's own lock; maybe on another computer."""


class SettingChanged(InstrumentError):
    """A setting is no longer what it was set to: somebody else changed it, by another program or at the front panel."""


class LightLost(InstrumentError):
    """Light that was let through no longer is, by another hand: it is not for this program to bring it back."""


class DoubtfulRecord(InstrumentError):
    """The record of a shot looks like that of another picture: measured again, it shows whether it is."""


class NoTrigger(InstrumentError):
    """The oscilloscope answers and is armed, but its trigger does not come: measuring again would not help."""


class OutOfRange(InstrumentError):
    """A value lies outside what the instrument or the station allows; nothing was sent."""

    exit_status: ClassVar[int] = 2


class NotConfigured(InstrumentError):
    """The driver lacks something only the operator can supply, such as a command of an undocumented laser."""

    exit_status: ClassVar[int] = 2
