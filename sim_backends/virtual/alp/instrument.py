"""The virtual DMD: the calls of the ALP library as lines, each answered by its return code.

`ALP:SEQALLOC 1,10` is AlpSeqAlloc with two arguments; inquiries and allocations answer `code,value`. Source: instrument
facts 4.2 and hardware truth, ALP DMD. The client that has allocated the device holds it until it frees it or its
connection ends, as a process holds the USB device; others are refused. Sequences play on the virtual clock. In slave
mode the generator's marker 1 is the trigger input: every segment it plays with a marker latches the next picture. Not
simulated: grey scales in time (one binary plane stays as long as a picture is shown), TRIGGER_IN_DELAY, PROJ_STEP, the
trigger's edge. Not known: what stays on the mirrors when a sequence with dark phases has ended; here the darkness.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import mirrors
from sim_backends.optics.mirrors import COLUMNS, ROWS
from sim_backends.scpi.arguments import block, integer, optional
from sim_backends.scpi.commands import Action, Command, chunks
from sim_backends.scpi.messages import Chunk, Message, Unit
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.alp import codes
from sim_backends.virtual.alp.sequence import LEAST_PICTURE_US, Sequence
from sim_backends.virtual.instrument import COMMON, Execution, VirtualInstrument
from sim_backends.world.signals import Projection
from sim_backends.world.world import World

SERIAL = 13042
VERSION = 43
MEMORY = 43_690  # binary frames, a recalled size; clients ask for it
UPLOAD_S = 5e-3  # a frame: 96 KiB over USB 2 at 20 MB/s
SHOW_S = LEAST_PICTURE_US * 1e-6  # loading the mirrors, reset and settling

_DEVICE_CHOICES = {
    codes.SYNCH_POLARITY: (codes.LEVEL_HIGH, codes.LEVEL_LOW),
    codes.TRIGGER_EDGE: (codes.EDGE_FALLING, codes.EDGE_RISING),
    codes.TRIGGER_TIME_OUT: (0, 1),
    codes.DMD_TYPE: (codes.XGA_07A,),
    codes.DMD_MODE: (codes.DMD_RESUME, codes.DMD_POWER_FLOAT),
}
_PROJECTION_CHOICES = {
    codes.PROJECTION_MODE: (codes.MASTER, codes.SLAVE),
    codes.STEP: (codes.DEFAULT, codes.EDGE_FALLING, codes.EDGE_RISING),
    codes.INVERSION: (0, 1),
    codes.UPSIDE_DOWN: (0, 1),
}
_EVERYBODYS = {"ALP:DEVALLOC", *(command.header for command in COMMON if command.header != "*RST")}
"""Commands that a client may send who does not hold the device."""
_NUMBER = integer(-(2**31), 2**31 - 1)
_TIMES = (integer(), integer(), integer(), integer(), integer())


class VirtualAlp(VirtualInstrument):
    """What a client of an ALP controller can see, and which way the mirrors point."""

    IDENTITY = f"ViALUX,ALP-4.3 (simulated),{SERIAL},{VERSION}"
    COMMANDS = (
        Action("ALP:DEVALLOC", "allocate", optional(_NUMBER)),
        Action("ALP:DEVFREE", "free"),
        Action("ALP:DEVHALT", "halt"),
        Action("ALP:DEVINQUIRE", "inquire", _NUMBER),
        Action("ALP:DEVCONTROL", "control", _NUMBER, _NUMBER),
        Action("ALP:SEQALLOC", "allocate_sequence", _NUMBER, _NUMBER),
        Action("ALP:SEQFREE", "free_sequence", _NUMBER),
        Action("ALP:SEQPUT", "put", _NUMBER, _NUMBER, _NUMBER, block("u1")),
        Action("ALP:SEQCONTROL", "control_sequence", _NUMBER, _NUMBER, _NUMBER),
        Action("ALP:SEQINQUIRE", "inquire_sequence", _NUMBER, _NUMBER),
        Action("ALP:SEQTIMING", "set_timing", _NUMBER, *_TIMES),
        Action("ALP:PROJCONTROL", "control_projection", _NUMBER, _NUMBER),
        Action("ALP:PROJINQUIRE", "inquire_projection", _NUMBER),
        Action("ALP:PROJSTART", "start_once", _NUMBER),
        Action("ALP:PROJSTARTCONT", "start_for_ever", _NUMBER),
        Action("ALP:PROJHALT", "halt_projection"),
        Action("ALP:PROJWAIT", "wait"),
    )

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._identifiers = 0
        self._speaker: AlpConnection | None = None
        self._power_on()

    def _power_on(self) -> None:
        self._allocated = False
        self._holder: AlpConnection | None = None
        self._sequences: dict[int, Sequence] = {}
        self._device = {kind: values[0] for kind, values in _DEVICE_CHOICES.items()}
        self._projection = {kind: values[0] for kind, values in _PROJECTION_CHOICES.items()}
        self._shown: Sequence | None = None
        self._ends_s = np.inf  # virtual time at which a finite run is over; infinite for an endless one
        self._frames_to_latch: int | None = None  # by triggers, of a finite run in slave mode
        self.world.show(None)

    @contextmanager
    def connection(self) -> Iterator["AlpConnection"]:
        """As one client has it; when the client is gone, what it held is as after power-on.

        Source: alp.h, ALP_USB_RESET, "default: stop running sequences and DLP" after a disconnection.
        """
        connection = AlpConnection(self)
        yield connection
        if self._holder is connection:
            self._power_on()

    def run_for(self, connection: "AlpConnection", message: Message) -> Execution:
        """Execute what a client has sent."""
        self._speaker = connection
        try:
            return (yield from self.run(message))
        finally:
            self._speaker = None

    def prepare(self, command: Command, *, query: bool) -> None:
        """A device that one client holds is no other's: 1003, its library has no such device."""
        if self._speaker and self._holder not in (None, self._speaker) and command.header not in _EVERYBODYS:
            raise ScpiError(codes.BAD_DEVICE)

    def reset(self) -> None:
        """`*RST`: as after power-on, mirrors floating."""
        self._power_on()

    def refused(self, unit: Unit, error: ScpiError) -> list[Chunk]:
        """Every line is answered: by the library's return code where it has one."""
        if unit.header.startswith("*"):
            return super().refused(unit, error)
        if error.code > 0:
            return chunks(error.code)
        return chunks(codes.USER_DATA_ERROR if error.code in (-160, -161) else codes.PARAMETER_INVALID)

    # --- device

    def allocate(self, serial: int | None) -> int:
        """`AlpDevAlloc`: 1004 twice, 1001 for a serial number that is not there; none or 0 is any."""
        if self._allocated:
            raise ScpiError(codes.ALREADY_ALLOCATED)
        if serial not in (None, codes.DEFAULT, SERIAL):
            raise ScpiError(codes.NOT_ONLINE)
        self._allocated, self._holder = True, self._speaker
        return codes.OK

    def free(self) -> int:
        """`AlpDevFree`: the mirrors float; 1002 while a sequence is shown."""
        self._require_idle()
        self._power_on()
        return codes.OK

    def halt(self) -> int:
        """`AlpDevHalt`: the mirrors are parked until the next start."""
        self._require_device()
        self.world.show(None)
        self._shown = None
        return codes.OK

    def inquire(self, kind: int) -> str:
        """`AlpDevInquire`."""
        self._require_device()
        facts = {
            codes.DEVICE_NUMBER: SERIAL,
            codes.VERSION: VERSION,
            codes.DEVICE_STATE: codes.DEVICE_BUSY if self._active() else codes.DEVICE_IDLE,
            codes.AVAILABLE_MEMORY: self._free_memory(),
            codes.DISPLAY_HEIGHT: ROWS,
            codes.DISPLAY_WIDTH: COLUMNS,
            **self._device,
        }
        return _answer(facts, kind)

    def control(self, kind: int, value: int) -> int:
        """`AlpDevControl`; DMD_MODE POWER_FLOAT lets the mirrors float until the next start."""
        self._require_idle()
        _choose(self._device, _DEVICE_CHOICES, kind, value)
        if kind == codes.DMD_MODE and value == codes.DMD_POWER_FLOAT:
            self.world.show(None)
        return codes.OK

    # --- sequences

    def allocate_sequence(self, bit_planes: int, pictures: int) -> str:
        """`AlpSeqAlloc`: 1007 when memory does not suffice."""
        self._require_device()
        if not 1 <= bit_planes <= 8 or pictures < 1:
            raise ScpiError(codes.PARAMETER_INVALID)
        if bit_planes * pictures > self._free_memory():
            raise ScpiError(codes.MEMORY_FULL)
        self._identifiers += 1
        self._sequences[self._identifiers] = Sequence(bit_planes, pictures)
        return f"{codes.OK},{self._identifiers}"

    def free_sequence(self, identifier: int) -> int:
        """`AlpSeqFree`: 1008 while it is shown."""
        self._unused(identifier)
        del self._sequences[identifier]
        return codes.OK

    def put(self, identifier: int, offset: int, count: int, data: NDArray[np.uint8]) -> int:
        """`AlpSeqPut`: pictures from `offset` on; 1006 for data of another length, 1008 while the sequence is shown."""
        if offset < 0 or count < 0:
            raise ScpiError(codes.PARAMETER_INVALID)
        sequence = self._unused(identifier)
        count = count or sequence.pictures - offset
        if count <= 0 or offset + count > sequence.pictures:
            raise ScpiError(codes.PARAMETER_INVALID)
        form = sequence.controls[codes.DATA_FORMAT]
        sequence.counts[offset : offset + count] = mirrors.on_counts(_packed(data, count, form, sequence.bit_planes))
        self.world.clock.advance(UPLOAD_S * count)
        return codes.OK

    def control_sequence(self, identifier: int, kind: int, value: int) -> int:
        """`AlpSeqControl`: 1008 while the sequence is shown."""
        self._unused(identifier).control(kind, value)
        return codes.OK

    def inquire_sequence(self, identifier: int, kind: int) -> str:
        """`AlpSeqInquire`."""
        return f"{codes.OK},{self._sequence(identifier).inquire(kind)}"

    def set_timing(
        self, identifier: int, illuminate: int, picture: int, delay: int, width: int, trigger_delay: int
    ) -> int:
        """`AlpSeqTiming`: 1008 while the sequence is shown."""
        self._unused(identifier).set_timing(illuminate, picture, delay, width, trigger_delay)
        return codes.OK

    # --- projection

    def control_projection(self, kind: int, value: int) -> int:
        """`AlpProjControl`; takes effect with the next start, 1002 while a sequence is shown."""
        self._require_idle()
        _choose(self._projection, _PROJECTION_CHOICES, kind, value)
        return codes.OK

    def inquire_projection(self, kind: int) -> str:
        """`AlpProjInquire`."""
        self._require_device()
        state = codes.ACTIVE if self._active() else codes.IDLE
        return _answer({codes.PROJECTION_STATE: state, **self._projection}, kind)

    def start_once(self, identifier: int) -> int:
        """`AlpProjStart`: the range of frames, as often as REPEAT says; the last one stays."""
        self._start(self._sequence(identifier), loop=False)
        return codes.OK

    def start_for_ever(self, identifier: int) -> int:
        """`AlpProjStartCont`: the range of frames again and again, until it is halted."""
        self._start(self._sequence(identifier), loop=True)
        return codes.OK

    def halt_projection(self) -> int:
        """`AlpProjHalt`: the picture that is shown now stays."""
        self._require_device()
        if self._active():
            self.world.hold()
        self._shown = None
        return codes.OK

    def wait(self) -> int:
        """`AlpProjWait`: until a finite run is over, in virtual time; 1005 if it has no end of its own."""
        self._require_device()
        if self._active():
            if self._ends_s == np.inf:
                raise ScpiError(codes.PARAMETER_INVALID)
            self.world.clock.advance(self._ends_s - self.world.clock.now)
            self._shown = None
        return codes.OK

    def _start(self, sequence: Sequence, *, loop: bool) -> None:
        """Latch the first picture now; in slave mode the first edge does."""
        if self._device[codes.DMD_MODE] == codes.DMD_POWER_FLOAT:
            raise ScpiError(codes.NOT_IDLE)
        slave = self._projection[codes.PROJECTION_MODE] == codes.SLAVE
        controls, timing = sequence.controls, sequence.timing
        now_s, picture_time_s = self.world.clock.now, 1e-6 * timing[codes.PICTURE_TIME]
        self._shown = sequence
        self._frames_to_latch = sequence.frames if slave and not loop else None
        self._ends_s = np.inf if loop or slave else now_s + sequence.frames * picture_time_s
        self.world.project(
            Projection(
                self.turned(sequence.counts[controls[codes.FIRST_FRAME] : controls[codes.LAST_FRAME] + 1]),
                now_s,
                picture_time_s,
                synch_delay_s=1e-6 * timing[codes.SYNCH_DELAY],
                loop=loop,
                triggered=slave,
                synch_pulse_s=1e-6 * timing[codes.SYNCH_PULSE_WIDTH],
                synch_high=self._device[codes.SYNCH_POLARITY] == codes.LEVEL_HIGH,
                repeats=1 if loop else controls[codes.REPEAT],
                lit_s=math.inf if sequence.uninterrupted else 1e-6 * timing[codes.ILLUMINATE_TIME],
            )
        )
        self.world.clock.advance(SHOW_S)

    def turned(self, counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Mirrors on, as the projection's controls have the pictures of a sequence turned."""
        if self._projection[codes.UPSIDE_DOWN]:
            counts = mirrors.upside_down(counts)
        return mirrors.inverted(counts) if self._projection[codes.INVERSION] else counts

    def _active(self) -> bool:
        """Whether a projection runs; a finite one that is over leaves its last picture."""
        to_latch = self._frames_to_latch
        if self.world.clock.now >= self._ends_s or (to_latch is not None and self.world.pictures_shown() >= to_latch):
            self._shown = None
        return self._shown is not None

    # --- what a call requires

    def _require_device(self) -> None:
        if not self._allocated:
            raise ScpiError(codes.BAD_DEVICE)

    def _require_idle(self) -> None:
        self._require_device()
        if self._active():
            raise ScpiError(codes.NOT_IDLE)

    def _sequence(self, identifier: int) -> Sequence:
        self._require_device()
        if identifier not in self._sequences:
            raise ScpiError(codes.PARAMETER_INVALID)
        return self._sequences[identifier]

    def _unused(self, identifier: int) -> Sequence:
        sequence = self._sequence(identifier)
        if self._active() and sequence is self._shown:
            raise ScpiError(codes.SEQUENCE_IN_USE)
        return sequence

    def _free_memory(self) -> int:
        return MEMORY - sum(sequence.memory for sequence in self._sequences.values())


class AlpConnection:
    """The device as one client has it."""

    def __init__(self, device: VirtualAlp) -> None:
        self.run = partial(device.run_for, self)
        self.connection = device.connection
        self.listens, self.clear, self.status_byte = device.listens, device.clear, device.status_byte


def _choose(settings: dict[int, int], choices: dict[int, tuple[int, ...]], kind: int, value: int) -> None:
    """Set `kind` to one of its choices, ALP_DEFAULT being the first; 1005 for anything else."""
    if value == codes.DEFAULT:
        value = choices.get(kind, (value,))[0]
    if value not in choices.get(kind, ()):
        raise ScpiError(codes.PARAMETER_INVALID)
    settings[kind] = value


def _answer(facts: dict[int, int], kind: int) -> str:
    if kind not in facts:
        raise ScpiError(codes.PARAMETER_INVALID)
    return f"{codes.OK},{facts[kind]}"


def _packed(data: NDArray[np.uint8], count: int, form: int, bit_planes: int) -> NDArray[np.uint8]:
    """Mirror bits (count, 768, 128) of the uploaded bytes; packed top-down ones are not copied."""
    binary = form in (codes.BINARY_TOPDOWN, codes.BINARY_BOTTOMUP)
    if binary and bit_planes > 1:
        raise ScpiError(codes.PARAMETER_INVALID)
    shape = (count, ROWS, COLUMNS // 8 if binary else COLUMNS)
    if data.size != math.prod(shape):
        raise ScpiError(codes.USER_DATA_ERROR)
    pictures = data.reshape(shape)
    if binary:
        return pictures if form == codes.BINARY_TOPDOWN else pictures[:, ::-1]
    bit = 7 if form == codes.MSB_ALIGN else bit_planes - 1
    return np.packbits(pictures & np.uint8(1 << bit), axis=2)
