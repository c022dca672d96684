"""IEEE 488.2 status of a virtual instrument: event register, masks, status byte, and the queue of errors.

Codes and texts: SCPI-99, volume 2, chapter 21; registers: IEEE 488.2-1992, chapter 11.
"""

from collections import deque

TEXTS = {
    0: "No error",
    -100: "Command error",
    -102: "Syntax error",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -114: "Header suffix out of range",
    -160: "Block data error",
    -161: "Invalid block data",
    -200: "Execution error",
    -221: "Settings conflict",
    -222: "Data out of range",
    -224: "Illegal parameter value",
    -225: "Out of memory",
    -241: "Hardware missing",
    -250: "Mass storage error",
    -254: "Media full",
    -256: "File name not found",
    -257: "File name error",
    -350: "Queue overflow",
    -410: "Query INTERRUPTED",
    -420: "Query UNTERMINATED",
    2202: "Measurement error, No period found",
    2216: "Measurement error, No crossing, target waveform",
    2225: "Measurement error, No waveform to measure",
    2241: "Waveform request is invalid",
    2244: "Source waveform is not active",
}

OPERATION_COMPLETE = 0x01
QUERY_ERROR = 0x04
DEVICE_ERROR = 0x08
EXECUTION_ERROR = 0x10
COMMAND_ERROR = 0x20

EVENTS_AVAILABLE = 0x04  # bits of the status byte
MESSAGE_AVAILABLE = 0x10
EVENT_SUMMARY = 0x20
MASTER_SUMMARY = 0x40

QUEUE_LENGTH = 32  # items; recalled, no source states it


class ScpiError(Exception):
    """What a command refused to do: the SCPI `code` (negative) or a model's own (positive), and a detail."""

    def __init__(self, code: int, detail: str = "") -> None:
        super().__init__(f"{code}: {TEXTS.get(code, 'error')} ({detail})")
        self.code = code
        self.detail = detail

    @property
    def event(self) -> int:
        """The bit of the standard event status register that this error sets."""
        if self.code > 0:
            return EXECUTION_ERROR
        return {1: COMMAND_ERROR, 2: EXECUTION_ERROR, 3: DEVICE_ERROR, 4: QUERY_ERROR}[-self.code // 100]


class NotSimulated(ScpiError):
    """-113 for a header that instruments of the family have and their twin has not."""

    def __init__(self, header: str) -> None:
        super().__init__(-113, f"{header} is a real header that is not simulated")


class Status:
    """Event register, masks and an error queue that is read item by item (`SYSTem:ERRor?`), codes negative."""

    sign = 1
    separator = ";"

    def __init__(self) -> None:
        self.events = 0
        self.event_mask = 0
        self.service_mask = 0
        self.queue: deque[tuple[int, str]] = deque()

    def report(self, error: ScpiError) -> None:
        """Set the event bit of `error` and queue it; a full queue ends in -350 instead."""
        self.events |= error.event
        code = self.sign * error.code if error.code < 0 else error.code
        text = TEXTS.get(error.code, "Error")
        if error.detail:
            text += self.separator + error.detail.replace('"', "'")
        self._append(code, text)

    def complete(self) -> None:
        """An operation that `*OPC` asked about has finished."""
        self.events |= OPERATION_COMPLETE

    def read_events(self) -> int:
        """`*ESR?`: the event register, which is cleared."""
        events, self.events = self.events, 0
        return events

    def byte(self, *, message_available: bool = False) -> int:
        """The status byte with its master summary bit."""
        byte = EVENTS_AVAILABLE if self.queue else 0
        byte |= MESSAGE_AVAILABLE if message_available else 0
        byte |= EVENT_SUMMARY if self.events & self.event_mask else 0
        byte |= self.registers
        return byte | (MASTER_SUMMARY if byte & self.service_mask & ~MASTER_SUMMARY else 0)

    @property
    def registers(self) -> int:
        """The bits of the status byte that further registers set: there are none."""
        return 0

    def clear(self) -> None:
        """`*CLS`: forget events and errors, keep the masks."""
        self.events = 0
        self.queue.clear()

    def next_error(self) -> tuple[int, str]:
        """The oldest error, removed; (0, "No error") when there is none."""
        return self.queue.popleft() if self.queue else (0, TEXTS[0])

    def next_text(self) -> str:
        """The oldest error as `code,"text"`, removed."""
        code, text = self.next_error()
        return f'{code},"{text}"'

    def next_code(self) -> int:
        """The oldest error's code; the error is removed."""
        return self.next_error()[0]

    def count(self) -> int:
        """Errors that can be read."""
        return len(self.queue)

    def all_texts(self) -> str:
        """Every error that can be read, removed; the empty queue's item if there is none."""
        return ",".join(self.next_text() for _ in range(max(1, self.count())))

    def all_codes(self) -> str:
        """The codes of every error that can be read, removed."""
        return ",".join(str(self.next_code()) for _ in range(max(1, self.count())))

    def _append(self, code: int, text: str) -> None:
        if len(self.queue) < QUEUE_LENGTH:
            self.queue.append((code, text))
        else:
            self.queue[-1] = (self.sign * -350, TEXTS[-350])


class EventStatus(Status):
    """The event queue of the Tektronix oscilloscopes: codes are positive, and `*ESR?` releases the events to be read.

    Source: instrument facts 2.2.
    """

    sign = -1
    separator = "; "

    def __init__(self) -> None:
        super().__init__()
        self.enabled = 0xFF  # DESE: which event bits are recorded at all
        self.released: deque[tuple[int, str]] = deque()

    def report(self, error: ScpiError) -> None:
        """Queue `error` until `*ESR?` releases it; events that `DESE` masks are dropped."""
        if error.event & self.enabled:
            super().report(error)

    def complete(self) -> None:
        """Set the operation-complete bit and queue event 402."""
        if self.enabled & OPERATION_COMPLETE:
            super().complete()
            self._append(402, "Operation complete")

    def read_events(self) -> int:
        """`*ESR?`: the event register; its events replace those released before."""
        self.released, self.queue = self.queue, deque()
        return super().read_events()

    def clear(self) -> None:
        """`*CLS`: forget released events as well."""
        super().clear()
        self.released.clear()

    def next_error(self) -> tuple[int, str]:
        """The oldest released event, removed; event 1 says that `*ESR?` must be read first."""
        if self.released:
            return self.released.popleft()
        if self.queue:
            return 1, "No events to report - new events pending *ESR?"
        return 0, "No events to report - queue empty"

    def count(self) -> int:
        """Events that `*ESR?` has released."""
        return len(self.released)
