"""Going on after a mishap: every instrument is reached again and the bench is safe before anything is measured anew.

The light stays off meanwhile: only a protocol switches it on, by `Bench.emitting`.
"""

import logging
import time
from typing import NamedTuple

from instruments.bench import Bench
from instruments.errors import DoubtfulRecord, InstrumentError, LinkError, SettingChanged
from instruments.safe_state import over_a_new_link

ATTEMPTS = 3
"""So often in a row, without a record between, the bench is tried again."""
PAUSE_S = 1.0
"""What a network or an instrument gets to come back before each attempt."""


class Mishap(NamedTuple):
    """What a run can go on after: its error, its word in messages, and its events in the run's log."""

    error: type[InstrumentError]
    what: str
    event: str
    mended: str


MISHAPS = (
    Mishap(LinkError, "lost link", "link lost", "link recovered"),
    Mishap(SettingChanged, "setting changed from elsewhere", "setting changed", "settings mended"),
    Mishap(DoubtfulRecord, "doubtful record", "record doubted", "record measured again"),
)

_logger = logging.getLogger(__name__)


class Recovery:
    """Brings a bench back after a mishap, and reports to its observer every attempt and its outcome.

    Attributes:
        count: how often that was needed.
    """

    def __init__(self, bench: Bench) -> None:
        """Watch over `bench`."""
        self.count = 0
        self._bench = bench
        self._attempts = 0
        self._records = 0

    def after(self, error: InstrumentError, records: int) -> None:
        """Return when the bench is reached again and in the safe state; `records` have been stored so far.

        Raises:
            InstrumentError: `error` itself, if it is none of `MISHAPS`, came too often without a new record, from a
                simulated bench that failed or a replay that is over, or the bench does not come back; a note to it then
                says how the bench is left.
        """
        mishap = next((mishap for mishap in MISHAPS if isinstance(error, mishap.error)), None)
        if mishap is None or not self._bench.simulated_still():
            raise error
        if records > self._records or mishap.error is DoubtfulRecord:  # which the recorder bounds
            self._attempts, self._records = 0, records
        while self._attempts < ATTEMPTS:
            self._attempts += 1
            self._tell(
                mishap.event,
                f"{mishap.what} after {records} records, attempt {self._attempts} of {ATTEMPTS} to go on: {error}",
            )
            time.sleep(PAUSE_S)
            try:
                self._bench.make_safe()
                for instrument in self._bench.instruments.values():  # some are sent nothing on the way there
                    over_a_new_link(instrument.identify)
            except InstrumentError as failure:
                error.__notes__ = [str(failure)]  # what was noted when the link broke is no longer how things stand
            else:
                self._tell(
                    mishap.mended,
                    "all instruments answer and the bench is in the safe state: measuring what is missing",
                )
                self.count += 1
                return
        raise error

    def _tell(self, event: str, message: str) -> None:
        self._bench.observer.event(event, text=message)
        _logger.warning("%s", message)
