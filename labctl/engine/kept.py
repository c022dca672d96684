"""One bench through several runs: held all the time, and open as long as they have the same station."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from instruments.bench import Observer, Observers
from instruments.transcripts import Transcript
from labctl.bench.lock import Hold, held
from labctl.bench.opening import Access, OpenBench, opened
from labctl.bench.recording.wire import Wire
from labctl.bench.station import Station


class KeptBench:
    """What several runs share: nobody else gets the bench between two of them, and its links stay. Dark meanwhile.

    Attributes:
        hold: on the instruments of every station.
    """

    def __init__(self, hold: Hold) -> None:
        """Nothing is open yet."""
        self.hold = hold
        self._links = ExitStack()
        self._kept: tuple[Station, Access, OpenBench] | None = None
        self._observers = Observers()
        self._log: Transcript | None = None

    @contextmanager
    def opened(
        self, station: Station, transcript: Transcript, access: Access = Access(), *, observer: Observer | None = None
    ) -> Iterator[OpenBench]:
        """The bench of `station` for one run; as `opening.opened`, but its links stay open for the next one.

        They are closed before this ends where the run fails, and where the bench is another one. A bench that is
        simulated in this process, recorded or replayed is another one for each run.

        Raises:
            StationError, RecordingError, OutOfRange: as `opening.opened`.
        """
        if station.simulated or access.wire != Wire():
            with opened(station, transcript, access, observer=observer) as found:
                yield found
            return
        self._log = transcript
        self._observers.follow(observer or Observer())
        try:
            if self._kept is None or self._kept[:2] != (station, access):
                self.close()
                found = self._links.enter_context(opened(station, self._say, access, observer=self._observers))
                self._kept = station, access, found
            yield self._kept[2]
        except BaseException:
            self.close()
            raise
        finally:
            self._log = None
            self._observers.follow()

    def close(self) -> None:
        """Close the links that are open.

        Raises:
            InstrumentError: an instrument failed while it was released.
        """
        self._kept = None
        self._links.close()

    def _say(self, instrument: str, direction: str, message: str) -> None:
        if self._log is not None:
            self._log(instrument, direction, message)


@contextmanager
def kept(stations: Sequence[Station], task: str, wire: Wire = Wire()) -> Iterator[KeptBench]:
    """A bench for several runs on `stations`, one or more, held for the block.

    Raises:
        BenchInUse: another process has one of their instruments.
    """
    with held(stations[0], task, wire, also=stations[1:]) as hold:
        bench = KeptBench(hold)
        try:
            yield bench
        finally:
            bench.close()
