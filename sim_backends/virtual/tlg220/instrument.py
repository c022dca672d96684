"""The virtual tunable laser: it speaks the words of a table and is dark while it tunes.

Source: instrument facts 3. No public command set exists, so the table is data (`tlg220.toml` by default).
"""

from collections.abc import Mapping
from typing import Any

from sim_backends.scpi.messages import Chunk, Message, Unit
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.instrument import Execution, VirtualInstrument
from sim_backends.virtual.tlg220.table import (
    Phrase,
    default_table,
    phrases,
    power_in,
    power_w,
    wavelength_in,
    wavelength_nm,
)
from sim_backends.world.world import Emission, World

FIRST_WAVELENGTH_NM = 1550.0
FIRST_POWER_W = 10e-3
ROUNDING_S = 1e-9  # ten polls of 0.1 s are a second


class VirtualTlg220(VirtualInstrument):
    """What a client of the laser can see: the table's commands, and the common ones of IEEE 488.2 besides.

    Args:
        world: takes the light.
        table: a laser table; its own by default.

    Raises:
        ValueError: an entry of the table cannot be simulated.
    """

    IDENTITY = "Alnair Labs,TLG-220 (simulated),SIM0001,1.0"

    def __init__(self, world: World, table: Mapping[str, Any] | None = None) -> None:
        super().__init__(world)
        self._phrases = phrases(default_table() if table is None else table)
        self._settled_s = 0.0
        self.reset()

    def reset(self) -> None:
        """`*RST`: emission off, first wavelength and power."""
        self._output = False
        self._power_w = FIRST_POWER_W
        self._wavelength_nm = FIRST_WAVELENGTH_NM
        self._emit()

    def run(self, message: Message) -> Execution:
        """Execute what the table knows; the rest are common commands or errors."""
        texts = [_text(unit) for unit in message.units]
        if len(texts) > 1 and (reply := self._said(";".join(texts))) is not None:
            return reply
        whole: list[Chunk] = []
        for unit, text in zip(message.units, texts, strict=True):
            reply = self._said(text)
            if reply is None:
                reply = yield from super().run(Message((unit,)))
            if reply:
                whole += [b";", *reply] if whole else reply
        return whole

    def pending(self) -> bool:
        """Tuning is waited for in virtual time."""
        self.world.clock.advance(max(0.0, self._settled_s - self.world.clock.now))
        return False

    def _said(self, text: str) -> list[Chunk] | None:
        """Carry out the phrase that `text` is; its reply, or None if the table does not know it."""
        try:
            for phrase in self._phrases:
                value = phrase.value(text)
                if value is not None:
                    groups = getattr(self, f"_{phrase.name}")(phrase, value)
                    return [phrase.reply(**groups)] if phrase.answers else []
        except ScpiError as error:
            self.status.report(error)
            return []
        return None

    def _emit(self) -> None:
        light = Emission(self._wavelength_nm, self._power_w) if self._output else None
        self.world.emit(light, lit_from_s=self._settled_s)

    # --- the entries of a table: each gets its phrase and the number sent, and returns the groups of the reply

    def _identify(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        return {"text": self.IDENTITY}

    def _set_wavelength(self, phrase: Phrase, value: float) -> dict[str, object]:
        wanted = wavelength_nm(value, phrase.unit)
        if wanted != self._wavelength_nm:
            self._wavelength_nm = wanted
            self._settled_s = self.world.clock.now + self.world.parameters.laser_tuning_s
            self._emit()
        return {}

    def _get_wavelength(self, phrase: Phrase, _value: float) -> dict[str, object]:
        return {"value": f"{wavelength_in(phrase.unit, self._wavelength_nm):.10g}"}

    def _set_power(self, phrase: Phrase, value: float) -> dict[str, object]:
        self._power_w = power_w(value, phrase.unit)
        self._emit()
        return {}

    def _get_power(self, phrase: Phrase, _value: float) -> dict[str, object]:
        return {"value": f"{power_in(phrase.unit, self._power_w):.6g}"}

    def _output_on(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        self._output = True
        self._emit()
        return {}

    def _output_off(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        self._output = False
        self._emit()
        return {}

    def _get_output(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        return {"value": int(self._output)}

    def _is_settled(self, phrase: Phrase, _value: float) -> dict[str, object]:
        self.world.clock.advance(phrase.poll_s)  # the client lets this pass between two askings
        return {"value": int(self.world.clock.now >= self._settled_s - ROUNDING_S)}

    def _error(self, _phrase: Phrase, _value: float) -> dict[str, object]:
        code, text = self.status.next_error()
        return {"code": code, "text": text}


def _text(unit: Unit) -> str:
    """A unit as it was sent, but for white space; blocks have no text."""
    arguments = ",".join(argument if isinstance(argument, str) else "" for argument in unit.arguments)
    return f"{unit.header}{'?' if unit.query else ''} {arguments}".rstrip()
