"""What the virtual DLPC900 understands: commands by number, in the layouts of TI's programmer's guide (DLPU018J).

Numbers and layouts of those that the guide's pages were not at hand for are from public drivers of the device
(instrument facts 4.3) and from the vendor's own API source, which names every command with its length.
"""

from typing import NamedTuple

WORKS, WITHOUT_EFFECT = "works", "accepted without effect"

VIDEO, PRE_STORED, VIDEO_PATTERN, ON_THE_FLY = range(4)
STOP, PAUSE, START = range(3)
AWAKE, STANDBY, RESET = range(3)

INVALID_COMMAND, NOT_IN_THIS_MODE, INVALID_PARAMETER, NOT_PRESENT = 3, 5, 6, 7
OUT_OF_MEMORY, INVALID_COMPRESSION, BAD_BIT, NOT_IN_FLASH = 8, 9, 10, 11
BAD_EXPOSURE, BAD_PATTERN_NUMBER, BAD_DEFINITION, BAD_IMAGE_ADDRESS = 14, 15, 16, 17
ERROR_TEXTS = {
    0: "no error",
    INVALID_COMMAND: "invalid command number",
    NOT_IN_THIS_MODE: "command not allowed in current mode",
    INVALID_PARAMETER: "invalid command parameter",
    NOT_PRESENT: "item referred by the parameter is not present",
    OUT_OF_MEMORY: "out of resource",
    INVALID_COMPRESSION: "invalid BMP compression type",
    BAD_BIT: "pattern bit number out of range",
    NOT_IN_FLASH: "pattern BMP not present in flash",
    BAD_EXPOSURE: "pattern exposure time out of range",
    BAD_PATTERN_NUMBER: "pattern number out of range",
    BAD_DEFINITION: "invalid pattern definition",
    BAD_IMAGE_ADDRESS: "pattern image memory address out of range",
}

LAST_ERROR, ERROR_TEXT, LOAD_IMAGE = 0x0100, 0x0101, 0x1A2B
IDLE, FLIP_LONG_AXIS, FLIP_SHORT_AXIS = 0x0201, 0x1008, 0x1009
TRIGGER_OUT_1, TRIGGER_OUT_2, INVERT, TRIGGER_IN_1 = 0x1A1D, 0x1A1E, 0x1A30, 0x1A35


class Refusal(Exception):
    """The device refuses a command; the argument is its error code."""


class Action(NamedTuple):
    """A command that does something: the layout of its data and the method that carries it out."""

    name: str
    layout: str
    method: str


class Reading(NamedTuple):
    """A command that is read: the method that gives its data."""

    name: str
    method: str


class Setting(NamedTuple):
    """Values that are written and read back: layout, values after power-on, limits of each."""

    name: str
    layout: str
    values: tuple[int, ...]
    limits: tuple[tuple[int, int], ...]
    state: str = WITHOUT_EFFECT


ACTIONS = {
    0x0200: Action("power mode", "<B", "set_power"),
    0x1A1B: Action("display mode", "<B", "set_mode"),
    0x1A24: Action("pattern display start, pause, stop", "<B", "run_patterns"),
    0x1A2A: Action("initialise pattern BMP load", "<HI", "announce"),
    LOAD_IMAGE: Action("pattern BMP load", "", "load"),
    0x1A31: Action("pattern LUT configuration", "<HI", "configure"),
    0x1A34: Action("pattern LUT definition", "<H3sB3sBH", "define"),
}
READINGS = {
    LAST_ERROR: Reading("error code", "last_error"),
    ERROR_TEXT: Reading("error description", "error_text"),
    0x0205: Reading("firmware version", "firmware_version"),
    0x0206: Reading("hardware and firmware tag", "firmware_tag"),
    0x1A0A: Reading("hardware status", "hardware_status"),
    0x1A0B: Reading("system status", "system_status"),
    0x1A0C: Reading("main status", "main_status"),
    0x1A1B: Reading("display mode", "display_mode"),
    0x1A31: Reading("pattern LUT configuration", "configuration"),
}
_POLARITY, _DELAY = (0, 1), (-20, 20_000)  # us
SETTINGS = {
    IDLE: Setting("idle mode", "<B", (0,), ((0, 1),), WORKS),
    FLIP_LONG_AXIS: Setting("long-axis image flip", "<B", (0,), (_POLARITY,), WORKS),
    FLIP_SHORT_AXIS: Setting("short-axis image flip", "<B", (0,), (_POLARITY,), WORKS),
    0x1A00: Setting("input source", "<B", (0,), ((0, 31),)),
    0x1A01: Setting("IT6535 power mode", "<B", (0,), ((0, 2),)),
    0x1A03: Setting("port and clock", "<B", (0,), ((0, 63),)),
    TRIGGER_OUT_1: Setting("trigger out 1", "<Bhh", (0, 0, 0), (_POLARITY, _DELAY, _DELAY)),
    TRIGGER_OUT_2: Setting("trigger out 2", "<Bhh", (0, 0, 0), (_POLARITY, _DELAY, _DELAY), WORKS),
    INVERT: Setting("pattern invert data", "<B", (0,), (_POLARITY,), WORKS),
    TRIGGER_IN_1: Setting("trigger in 1", "<HB", (105, 0), ((105, 65_535), _POLARITY), WORKS),
    0x1A36: Setting("trigger in 2", "<B", (0,), (_POLARITY,)),
}


def states() -> list[tuple[str, str, str]]:
    """One line a command: number and name, forms (`read`, `written`, `read and written`) and state."""
    lines = {}
    for number in sorted(ACTIONS.keys() | READINGS.keys() | SETTINGS.keys()):
        setting = SETTINGS.get(number)
        reads, writes = setting or READINGS.get(number), setting or ACTIONS.get(number)
        forms = [form for form, there in (("read", reads), ("written", writes)) if there]
        named = reads or writes
        if named is not None:
            state = setting.state if setting else WORKS
            lines[number] = (f"0x{number:04X} {named.name}", " and ".join(forms), state)
    return list(lines.values())
