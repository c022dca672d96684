"""Date and time of the virtual AWG: the virtual clock, shifted by what a client has set.

Source: instrument facts 1.2.
"""

from datetime import datetime, timedelta

from sim_backends.scpi.arguments import integer
from sim_backends.scpi.commands import Action, Query
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.waveforms import calendar
from sim_backends.world.world import VirtualClock

CALENDAR_COMMANDS = (
    Query("SYSTem:DATE?", "calendar.date"),
    Action("SYSTem:DATE", "calendar.set_date", integer(2000, 2099), integer(1, 12), integer(1, 31)),
    Query("SYSTem:TIME?", "calendar.time_of_day"),
    Action("SYSTem:TIME", "calendar.set_time", integer(0, 23), integer(0, 59), integer(0, 59)),
)


class Calendar:
    """The instrument's date and time."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._shift = timedelta()

    def _now(self) -> datetime:
        return calendar(self._clock.now) + self._shift

    def date(self) -> str:
        """Year, month, day."""
        return f"{self._now():%Y,%m,%d}"

    def set_date(self, year: int, month: int, day: int) -> None:
        """Set the date; -222 for a day that the month does not have."""
        try:
            wanted = self._now().replace(year=year, month=month, day=day)
        except ValueError:
            raise ScpiError(-222, f"{year}-{month}-{day}") from None
        self._shift += wanted - self._now()

    def time_of_day(self) -> str:
        """Hour, minute, second."""
        return f"{self._now():%H,%M,%S}"

    def set_time(self, hour: int, minute: int, second: int) -> None:
        """Set the time of day."""
        self._shift += self._now().replace(hour=hour, minute=minute, second=second) - self._now()
