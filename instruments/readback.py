"""Settings read back: what an instrument made of a value is compared with what it was asked for."""

import math

from instruments.errors import InstrumentError


def confirm(setting: str, asked: float, got: float, tolerance: float, *, unit: str = "", remedy: str = "") -> float:
    """Return what the instrument settled on, which is what the measurement goes on with.

    setting: instrument and setting, for the message. tolerance: how far `got` may lie from `asked`, in the same unit;
    instruments round to their own steps. remedy: what to do where it lies further.

    Raises:
        InstrumentError: the difference exceeds the tolerance, or `got` is not a number.
    """
    if not abs(got - asked) <= tolerance:
        digits = 6 if math.isclose(asked, got, rel_tol=1e-3) else 4
        space = f" {unit}" if unit else ""
        raise InstrumentError(
            f"{setting}: asked for {asked:.{digits}g}{space}, got {got:.{digits}g}{space}: "
            f"{remedy or 'choose a value the instrument supports'}"
        )
    return got
