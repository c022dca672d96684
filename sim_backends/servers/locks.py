"""The lock of a HiSLIP server (IVI-6.1, 6.5): one session alone, or several that know the same word."""

from collections.abc import Hashable
from enum import IntEnum
from typing import Generic, TypeVar

Holder = TypeVar("Holder", bound=Hashable)


class LockAnswer(IntEnum):
    """Codes of AsyncLockResponse."""

    FAILURE = 0
    SUCCESS = 1
    SHARED_RELEASED = 2
    ERROR = 3


class Locks(Generic[Holder]):
    """Who holds the lock.

    A request that cannot be granted fails at once, whatever time-out the client gave: nothing here waits on a clock.
    """

    def __init__(self) -> None:
        self.exclusive: Holder | None = None
        self._shared: set[Holder] = set()
        self._word = b""

    @property
    def holders(self) -> int:
        """How many sessions hold a lock."""
        return len(self._shared | ({self.exclusive} if self.exclusive is not None else set()))

    def request(self, holder: Holder, word: bytes) -> LockAnswer:
        """Ask for the exclusive lock (no `word`) or for the lock shared by all who give the same one."""
        if self.exclusive is not None:
            return LockAnswer.ERROR if self.exclusive == holder else LockAnswer.FAILURE
        if not word:
            if self._shared - {holder}:
                return LockAnswer.FAILURE
            self.exclusive = holder
            return LockAnswer.SUCCESS
        if self._shared and word != self._word:
            return LockAnswer.FAILURE
        self._shared.add(holder)
        self._word = word
        return LockAnswer.SUCCESS

    def release(self, holder: Holder) -> LockAnswer:
        """Give back the exclusive lock, or else the shared one."""
        if self.exclusive == holder:
            self.exclusive = None
            return LockAnswer.SUCCESS
        if holder in self._shared:
            self._shared.remove(holder)
            return LockAnswer.SHARED_RELEASED
        return LockAnswer.ERROR

    def forget(self, holder: Holder) -> None:
        """Give back whatever `holder` holds: it is gone."""
        if self.exclusive == holder:
            self.exclusive = None
        self._shared.discard(holder)

    def hold_off(self, holder: Holder) -> bool:
        """Whether `holder` must wait for others to release the lock."""
        if self.exclusive is not None:
            return self.exclusive != holder
        return bool(self._shared) and holder not in self._shared
