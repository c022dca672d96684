"""Going on after a lost link: every instrument is reached again and the bench is safe before anything is measured anew.

The light stays off meanwhile: only a protocol switches it on, by `Bench.emitting`.
"""

import logging
import time

from instruments.bench import Bench
from instruments.errors import InstrumentError, LinkError
from instruments.safe_state import UnsafeBench

ATTEMPTS = 3
"""So often in a row, without a record between, the bench is tried again."""
PAUSE_S = 1.0
"""What a network or an instrument gets to come back before each attempt."""

_logger = logging.getLogger(__name__)


class Recovery:
    """Brings a bench back after a lost link, and reports to its observer every attempt and its outcome.

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
            InstrumentError: `error` itself, if it was no lost link, came too often without a new record, or the bench
                does not come back; a note to it then says how the bench is left.
        """
        if not isinstance(error, LinkError):
            raise error
        if records > self._records:
            self._attempts, self._records = 0, records
        while self._attempts < ATTEMPTS:
            self._attempts += 1
            self._tell(
                "link lost",
                f"lost link after {records} records, attempt {self._attempts} of {ATTEMPTS} to go on: {error}",
            )
            time.sleep(PAUSE_S)
            try:
                self._bench.make_safe()
            except UnsafeBench as failure:
                error.__notes__ = [str(failure)]  # what was noted when the link broke is no longer how things stand
            else:
                self._tell(
                    "link recovered",
                    "all instruments answer and the bench is in the safe state: measuring what is missing",
                )
                self.count += 1
                return
        raise error

    def _tell(self, event: str, message: str) -> None:
        self._bench.observer.event(event, text=message)
        _logger.warning("%s", message)
