"""The virtual 6 Series B MSO: the acquisition system of its elder cousin behind another digitiser, in other words.

Source: the family's command descriptions in the package tm_devices; where points lie in time, the programmer manual of
the 5 Series MSO ("the returned value is always 0" for PT_OFF; XZERO is the time of the first point). Not simulated:
measurements, mathematics, stored references, spectra, digital channels, history, pixel maps (FastAcq) and averages made
in hardware. Assumed, because the descriptions leave it open: it has an auxiliary input; a record has as many points in
FastFrame as without; the lists of FastFrame look as `time_stamps` and `trigger_offsets` write them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import timedelta
from typing import Any, ClassVar

from sim_backends.scpi.arguments import nr3
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.mso6b.commands import COMMANDS, PLANNED_BY
from sim_backends.virtual.mso6b.model import BANDWIDTH_HZ, BITS, RECORDS
from sim_backends.virtual.oscilloscope.acquisition import AcquisitionSystem
from sim_backends.virtual.oscilloscope.fastframe import SWITCHED_ON
from sim_backends.virtual.oscilloscope.transfer import Preamble, Trace
from sim_backends.virtual.oscilloscope.vertical import CHANNELS
from sim_backends.world.world import World


@dataclass
class FilterShape:
    """What the low-pass filter of a channel is optimised for."""

    optimised_for: str = "FLATNESS"


@dataclass(frozen=True)
class Mso6bPreamble(Preamble):
    """Its points count from the first one that is sent, of which it tells the time after the trigger."""

    @property
    def first_point_s(self) -> float:
        """When the first point that is sent is due, after the trigger."""
        return -super().trigger_point * self.x_increment_s

    @property
    def x_zero_s(self) -> float:
        """Time of the first point, of the first frame that is sent."""
        return self.first_point_s + super().x_zero_s

    @property
    def trigger_point(self) -> int:
        """Always 0, for programs that were written for the elder cousin."""
        return 0


class VirtualMso6b(AcquisitionSystem):
    """What a client of an MSO64B can see: its settings, its records, its events."""

    IDENTITY = "TEKTRONIX,MSO64B,SIM0006,CF:91.1CT FV:2.4.4.1"
    OPTIONS = "6-BW-10000:License Option"
    SUFFIXES: ClassVar = {"CH": 4}
    COMMANDS = COMMANDS
    PLANNED_BY = PLANNED_BY
    RECORDS = RECORDS
    FULL_BANDWIDTH_HZ = BANDWIDTH_HZ
    BITS = BITS
    PREAMBLE = Mso6bPreamble

    def __init__(self, world: World, section: Mapping[str, Any] | None = None) -> None:
        super().__init__(world, section, effective_bits=world.parameters.enob_of_12_bits)
        self.acquisitions_of_a_sequence = self.every_sample = 1
        self.reset()

    def reset(self) -> None:
        """`*RST`: factory settings, but headers, verbosity and masks stay as they are."""
        super().reset()
        self.trigger.holdoff_by = "TIMe"
        self.filter_shapes = {number: FilterShape() for number in CHANNELS.values()}

    @property
    def trigger_slope(self) -> str:
        """The edge that triggers, on whatever source."""
        return self.trigger.present.slope

    @trigger_slope.setter
    def trigger_slope(self, word: str) -> None:
        for source in self.trigger.inputs.values():
            source.slope = word

    def time_stamps(self) -> str:
        """When each frame of the source was triggered: `1: DD.MM.YYYY.HH:MM::SS.xxxxxxxxxxxx, 2: ...`."""

        def stamp(trace: Trace, frame: int) -> str:
            seconds, picoseconds = divmod(round(trace.times_s[frame] * 1e12), 10**12)
            moment = SWITCHED_ON + timedelta(seconds=seconds)
            return f"{moment:%d.%m.%Y.%H:%M::%S}.{picoseconds:012}"

        return self._of_frames(stamp)

    def trigger_offsets(self) -> str:
        """Time of the first point of each frame of the source after its trigger, s: `1: 1.2E-12, 2: ...`."""
        return self._of_frames(
            lambda trace, frame: nr3(Mso6bPreamble(trace, self.transfer).first_point_s + float(trace.offsets_s[frame]))
        )

    def available_sources(self) -> str:
        """`DATa:SOUrce:AVAILable?`: the channels that are on."""
        return ",".join(name for name, number in CHANNELS.items() if self.channels[number].selected) or "NONE"

    @property
    def fast_averages(self) -> bool:
        """Averages in hardware are off and stay off: -221."""
        return False

    @fast_averages.setter
    def fast_averages(self, wanted: bool) -> None:
        if wanted:
            raise ScpiError(-221, "averages made in hardware are not simulated")

    def _of_frames(self, item: Callable[[Trace, int], str]) -> str:
        source = self.transfer.sources[0]
        if source not in CHANNELS:
            raise ScpiError(2244, source)
        trace = self.acquired_trace(CHANNELS[source])
        return ", ".join(f"{frame + 1}: {item(trace, frame)}" for frame in range(len(trace.codes)))
