"""Settings read back: what an instrument made of a value is compared with what it was asked for."""

import math
from collections.abc import Sequence

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


def confirm_off(what: str, answer: float, errors: Sequence[str], remedy: str) -> None:
    """Require the answer 0 of an instrument that was switched off: that decides, whatever it reports besides.

    An open interlock, say, makes a laser dark and fills its error queue. what: the case that it is not off, for the
    message. errors: its error queue, which may say why. remedy: what to do then.

    Raises:
        InstrumentError: it is not off.
    """
    if answer != 0:
        why = f" ({errors[0]})" if errors else ""
        raise InstrumentError(f"{what}{why}: {remedy}")
