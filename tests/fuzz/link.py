"""One client of one virtual instrument, without a network: bytes in, replies out, step by step."""

from collections import Counter, deque
from collections.abc import Iterable
from itertools import pairwise

from sim_backends.parameters import Parameters
from sim_backends.scpi.messages import Message, MessageReader
from sim_backends.virtual.instrument import VirtualInstrument
from sim_backends.world.world import World

SMALL = Parameters(chip_modes=50)
COUNTED: Counter[str] = Counter()
"""How many inputs (connections) and messages there have been."""

BEGINNINGS = {
    "VirtualAwg70002a": b'WLIS:WAV:NEW "m",2400;DATA "m",0,2,#18\x00\x00\x80\x3f\x00\x00\x00\xbf\n'
    b'WLIS:WAV:MARK:DATA "m",0,2,#12@@\nSOUR1:DAC:RES 9;CASS:WAV "m"\nAWGC:RUN;:OUTP1 1\n*CLS\n',
    "VirtualDpo72504dx": b"HOR:MODE MAN;MODE:RECO 200;:SEL:CH2 ON;:TRIG:A:MOD NORM;:ACQ:STOPA SEQ\nACQ:STATE RUN\n",
    "VirtualTlg220": b"OUTPUT ON\nWAVELENGTH 1551\n",
    "VirtualAlp": b"ALP:DEVALLOC\nALP:SEQALLOC 1,3\nALP:SEQCONTROL 1,2110,2\nALP:PROJSTARTCONT 1\n",
    "VirtualFibreSwitch": b"ROUT:CLOS (@1!2,2!3)\n",
}
"""What a client has usually done before: at work, the oscilloscope waiting for a trigger that will not come."""

WAITS = 8  # more than one message of these inputs can wait for


class Link:
    """A connection to an instrument of its own in a world of its own, fresh or `at_work`."""

    def __init__(self, model: type[VirtualInstrument], *, at_work: bool = False) -> None:
        COUNTED["inputs"] += 1
        self.instrument = model(World(SMALL))
        self.replies: list[bytes] = []
        self._reader = MessageReader()
        self._waiting: deque[Message] = deque()
        if at_work:
            self.send(BEGINNINGS.get(model.__name__, b"*CLS\n"))
            self.replies.clear()

    def send(self, stream: bytes, cuts: Iterable[int] = ()) -> None:
        """Send a stream, cut into packets at these places."""
        ends = [0, *sorted(cut for cut in set(cuts) if 0 < cut < len(stream)), len(stream)]
        for start, end in pairwise(ends):
            self._receive(stream[start:end])
        self._execute()

    def ask(self, text: bytes) -> list[bytes]:
        """Send one message whose end the transport marks; the replies it brings."""
        before = len(self.replies)
        self._receive(text)
        self._waiting.extend(self._reader.end())
        self._execute()
        return self.replies[before:]

    def finish(self) -> None:
        """End whatever message is under way, as a transport does that marks the ends of messages."""
        self._waiting.extend(self._reader.end())
        self._execute()

    def _receive(self, packet: bytes) -> None:
        while packet:
            room = self._reader.buffer()
            assert len(room) > 0
            count = min(len(room), len(packet))
            room[:count] = packet[:count]
            packet = packet[count:]
            self._waiting.extend(self._reader.received(count))

    def _execute(self) -> None:
        """Execute what has come. What waits is set free by another client, or else by a device clear."""
        while self._waiting:
            COUNTED["messages"] += 1
            execution = self.instrument.run(self._waiting.popleft())
            for set_free in (*[self._another_resets] * WAITS, execution.close):
                try:
                    next(execution)
                except StopIteration as end:
                    if end.value:
                        self.replies.append(b"".join(end.value))
                    break
                set_free()
            else:
                self.instrument.clear()

    def _another_resets(self) -> None:
        text = b"*RST\n"
        reader = MessageReader()
        reader.buffer()[: len(text)] = text
        for message in reader.received(len(text)):
            for _ in self.instrument.run(message):
                raise AssertionError("*RST waits")
