"""The setups of the virtual AWG: kept as the commands that make them, in an archive with the waveforms and sequences.

The archive is an `.awgx` as far as waveforms and sequences go; how the real one writes its settings is not known, so
that settings go between simulated instruments only. Outputs stay off when a setup is restored. Source: the vendor's
descriptions of `MMEMory:SAVE:SETup`, `MMEMory:OPEN:SETup`, `AWGControl:SSAVe` and `SREStore`.
"""

from collections.abc import Callable, Iterable, Iterator

from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.channels import Source

_WHOLE = (
    *("INSTrument:MODE", "INSTrument:COUPle:SOURce", "SOURce:RCCouple"),
    *("CLOCk:SOURce", "CLOCk:ECLock:FREQuency", "CLOCk:EREFerence:FREQuency", "CLOCk:SRATe", "CLOCk:JITTer"),
    *("CLOCk:PHASe:ADJust:DEGRees", "CLOCk:PHASe:ADJust:TIMe", "CLOCk:OUTPut", "CLOCk:SOUT"),
    *("TRIGger:SOURce", "TRIGger:INTerval"),
)
_OF_INPUT = ("TRIGger:LEVel", "TRIGger:SLOPe", "TRIGger:IMPedance", "TRIGger:MODE")
_OF_CHANNEL = (
    *("SOURce#:VOLTage", "SOURce#:DAC:RESolution", "SOURce#:SKEW", "SOURce#:TINPut", "SOURce#:RMODe"),
    *("OUTPut#:WVALue:ANALog", "OUTPut#:SVALue:ANALog"),
    *("FGEN:CHANnel#:TYPE", "FGEN:CHANnel#:FREQuency", "FGEN:CHANnel#:AMPLitude", "FGEN:CHANnel#:OFFSet"),
    *("FGEN:CHANnel#:DCLevel", "FGEN:CHANnel#:PHASe", "FGEN:CHANnel#:SYMMetry"),
)
_OF_MARKER = (  # the amplitude first: about the middle of after *RST every amplitude is possible
    *("SOURce#:MARKer%:VOLTage:AMPLitude", "SOURce#:MARKer%:VOLTage:OFFSet", "SOURce#:MARKer%:DELay"),
    *("OUTPut#:WVALue:MARKer%", "OUTPut#:SVALue:MARKer%"),
)
_ASSIGNMENTS = tuple(f"SOURce{number}:CASSet:{what}" for number in "12" for what in ("WAVeform", "SEQuence"))
_LAST = "AWGControl:ARSettings"  # what an asset recommends must not replace what was set
_NUMBERS = "12"


def _settings() -> Iterator[str]:
    yield from _WHOLE
    for number in _NUMBERS:
        yield from (header.replace("#", number) for header in _OF_CHANNEL)
        for marker in _NUMBERS:
            yield from (header.replace("#", number).replace("%", marker) for header in _OF_MARKER)


def commands(answer: Callable[[str], str], sources: Iterable[Source]) -> list[str]:
    """The commands that make the present setup; `answer` gives the instrument's answers."""
    lines = [f"{header} {answer(f'{header}?')}" for header in _settings()]
    for name in ("ATRigger", "BTRigger"):
        lines += [f"{header} {answer(f'{header}? {name}')},{name}" for header in _OF_INPUT]
    for source in sources:
        header = f"SOURce{source.number}:CASSet"
        if source.waveform is not None:
            lines.append(f'{header}:WAVeform "{source.waveform.name}",{source.component}')
        elif source.sequence is not None:
            lines.append(f'{header}:SEQuence "{source.sequence.name}",{source.track},{source.component}')
    return [*lines, f"{_LAST} {answer(f'{_LAST}?')}"]


def checked(text: str) -> list[str]:
    """The commands of a setup that comes from a file; -200 for one with any other command."""
    allowed = {*_settings(), *_OF_INPUT, *_ASSIGNMENTS, _LAST}
    lines = text.splitlines()
    if any(line.partition(" ")[0] not in allowed for line in lines):
        raise ScpiError(-200, "a file with other things than settings")
    return lines
