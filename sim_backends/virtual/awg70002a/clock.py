"""The clock of the virtual AWG: its source, rates, references and outputs.

Source: instrument facts 1.3. Nothing is wired to the clock and reference inputs: with a source there no clock runs, and
nothing comes out. Ranges of the reference and the phase, and the frequency of Clock Out, are recalled.
"""

from sim_backends.scpi.arguments import boolean, integer, keyword, real
from sim_backends.scpi.commands import Action, Query, Setting
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.waveforms import RATES

EXTERNAL_CLOCK_HZ = (6.25e9, 12.5e9)
RATE_FOR_CLOCK = 2  # an AWG70002A samples at most twice a period of the external clock
REFERENCE_HZ = (35e6, 250e6)  # recalled
PHASE_DEGREES = 10800  # recalled
PHASE_S = 5e-9  # recalled
CONNECTORS = {"EFIXed": "Reference In", "EVARiable": "Reference In", "EXTernal": "Clock In"}

CLOCK_COMMANDS = (
    Setting("CLOCk:SRATe", "timing.sample_rate", real(*RATES)),
    Setting("[SOURce#:]FREQuency[:CW]", "timing.sample_rate", real(*RATES)),
    Setting("[SOURce#:]FREQuency:FIXed", "timing.sample_rate", real(*RATES)),
    Setting("CLOCk:SOURce", "timing.source", keyword("INTernal", "EFIXed", "EVARiable", "EXTernal")),
    Setting("AWGControl:CLOCk:SOURce", "timing.source", keyword("INTernal", "EFIXed", "EVARiable", "EXTernal")),
    Setting("CLOCk:ECLock:FREQuency", "timing.external_hz", real(*EXTERNAL_CLOCK_HZ)),
    Action("CLOCk:ECLock:FREQuency:DETect", "timing.detect_clock"),
    Action("CLOCk:ECLock:FREQuency:ADJust", "timing.adjust"),
    Setting("CLOCk:EREFerence:FREQuency", "timing.reference_hz", real(*REFERENCE_HZ), effect=False),
    Action("CLOCk:EREFerence:FREQuency:DETect", "timing.detect_reference"),
    Setting("CLOCk:JITTer", "timing.jitter_reduced", boolean, effect=False),
    Setting("CLOCk:PHASe:ADJust:DEGRees", "timing.phase_degrees", integer(-PHASE_DEGREES, PHASE_DEGREES), effect=False),
    Setting(
        "AWGControl:CLOCk:PHASe:ADJust", "timing.phase_degrees", integer(-PHASE_DEGREES, PHASE_DEGREES), effect=False
    ),
    Setting("CLOCk:PHASe:ADJust:TIMe", "timing.phase_s", real(-PHASE_S, PHASE_S), effect=False),
    Setting("CLOCk:OUTPut[:STATe]", "timing.clock_output", boolean, effect=False),
    Query("CLOCk:OUTPut:FREQuency?", "timing.output_hz"),
    Setting("CLOCk:SOUT[:STATe]", "timing.sync_output", boolean, effect=False),
)


class Timing:
    """Settings of the clock after *RST: internal, at the highest rate."""

    def __init__(self) -> None:
        self._source = "INTernal"
        self._sample_rate = RATES[1]
        self._external_hz = EXTERNAL_CLOCK_HZ[0]
        self.reference_hz = REFERENCE_HZ[0]
        self.jitter_reduced = False
        self.phase_degrees = 0
        self.phase_s = 0.0
        self.clock_output = self.sync_output = False

    @property
    def sample_rate(self) -> float:
        """Sample rate (S/s); -222 above what the clock allows."""
        return self._sample_rate

    @sample_rate.setter
    def sample_rate(self, rate: float) -> None:
        if rate > self.highest_rate:
            raise ScpiError(-222, f"{rate:g} S/s, the external clock allows {self.highest_rate:g} S/s")
        self._sample_rate = rate

    @property
    def source(self) -> str:
        """Where the clock comes from."""
        return self._source

    @source.setter
    def source(self, word: str) -> None:
        self._source = word
        self._sample_rate = min(self._sample_rate, self.highest_rate)

    @property
    def external_hz(self) -> float:
        """Expected frequency of the external clock (Hz)."""
        return self._external_hz

    @external_hz.setter
    def external_hz(self, hz: float) -> None:
        self._external_hz = hz
        self._sample_rate = min(self._sample_rate, self.highest_rate)

    @property
    def highest_rate(self) -> float:
        """The highest sample rate the clock allows (S/s)."""
        return min(RATES[1], RATE_FOR_CLOCK * self._external_hz) if self._source == "EXTernal" else RATES[1]

    @property
    def missing(self) -> str:
        """The connector that the clock should come in at and does not; empty for the internal one."""
        return CONNECTORS.get(self._source, "")

    def require(self) -> None:
        """-241 where no clock comes in."""
        if self.missing:
            raise ScpiError(-241, f"no signal at {self.missing}")

    def detect_clock(self) -> None:
        """`CLOCk:ECLock:FREQuency:DETect`: -241, nothing is wired to the input."""
        raise ScpiError(-241, "no signal at Clock In")

    def detect_reference(self) -> None:
        """`CLOCk:EREFerence:FREQuency:DETect`: -241, nothing is wired to the input."""
        raise ScpiError(-241, "no signal at Reference In")

    def adjust(self) -> None:
        """`CLOCk:ECLock:FREQuency:ADJust`: the clock is in order."""

    def output_hz(self) -> float:
        """Frequency at Clock Out (Hz): half the sample rate."""
        return self._sample_rate / RATE_FOR_CLOCK
