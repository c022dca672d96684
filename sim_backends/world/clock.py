"""The virtual clock: what waiting costs on the simulated bench, without anybody waiting."""


class VirtualClock:
    """Virtual time of a bench in seconds since it was switched on."""

    def __init__(self) -> None:
        self._now = 0.0

    @property
    def now(self) -> float:
        """Virtual time (s)."""
        return self._now

    def advance(self, seconds: float) -> None:
        """Let `seconds` of virtual time pass.

        Raises:
            ValueError: `seconds` is negative or not a number.
        """
        if not seconds >= 0:
            raise ValueError(f"the virtual clock cannot advance by {seconds} s: give a time of at least 0")
        self._now += seconds
