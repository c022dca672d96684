"""The virtual real-time oscilloscope: arming, acquisition, events, and what clients read of them.

Source: instrument facts 2.1 to 2.10. Not simulated: FastFrame, measurements, cursors, mathematics.
"""

import struct
from itertools import groupby
from math import ceil
from time import perf_counter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics import receiver
from sim_backends.scpi.arguments import boolean, integer, keyword, run_or_stop
from sim_backends.scpi.commands import Action, Chunk, Query, Setting, reply_header
from sim_backends.scpi.status import EventStatus, ScpiError
from sim_backends.virtual.dpo_settings import (
    CHANNELS,
    HORIZONTAL_COMMANDS,
    RATES,
    TRIGGER_COMMANDS,
    VERTICAL_COMMANDS,
    Channel,
    Horizontal,
    Trigger,
    Vertical,
)
from sim_backends.virtual.dpo_transfer import NO_CODES, PREAMBLE, TRANSFER_COMMANDS, Codes, Preamble, Trace, Transfer
from sim_backends.virtual.instrument import VirtualInstrument
from sim_backends.world import Acquisition, Record, World

ARM_S = 20e-3  # recalled: from RUN until the acquisition system waits for a trigger
READ_S = 5e-3  # recalled: a record of some thousand points from acquisition memory to the network
REARM_S = 10e-6  # recalled: dead time between the acquisitions of an average
AUTO_TRIGGER_S = 0.1  # recalled: AUTO mode waits this long for a trigger before it does without
TRIGGERS_AT_ONCE = 64  # of an average; bounds the memory, not the result


class VirtualDpo72504dx(VirtualInstrument):
    """What a client of a DPO72504DX can see: its settings, its records, its events."""

    IDENTITY = "TEKTRONIX,DPO72504DX,SIM0001,CF:91.1CT FV:10.8.3 Build 3"
    SUFFIXES: ClassVar = {"CH": 4}
    DEFAULT_SUFFIX = None
    COMMANDS = (
        Setting("HEADer", "headers", boolean),
        Setting("HDR", "headers", boolean),
        Setting("VERBose", "verbose", boolean),
        Query("ID?", "short_identity"),
        Query("ALLEv?", "status.all_texts"),
        Query("EVMsg?", "status.next_text"),
        Query("EVENT?", "status.next_code"),
        Query("EVQty?", "status.count"),
        Setting("DESE", "status.enabled", integer(0, 255)),
        Setting("*PSC", "clears_at_power_on", boolean),
        Action("FACtory", "restore_factory_settings"),
        *VERTICAL_COMMANDS,
        *HORIZONTAL_COMMANDS,
        *TRIGGER_COMMANDS,
        Action("TRIGger", "force_trigger", keyword("FORCe")),
        Query("TRIGger:STATE?", "trigger_state"),
        Query("TRIGger:A:READY?", "waiting_for_trigger"),
        Setting("ACQuire:STATE", "acquiring", run_or_stop),
        Setting("ACQuire:STOPAfter", "stop_after", keyword("RUNSTop", "SEQuence")),
        Setting("ACQuire:MODe", "acquisition_mode", keyword("SAMple", "PEAKdetect", "HIRes", "AVErage")),
        Setting("ACQuire:MODe:ACTUal?", "actual_mode", keyword("SAMple", "AVErage")),
        Setting("ACQuire:NUMAVg", "averages", integer(2, 10240)),
        Setting("ACQuire:SAMPlingmode", "sampling_mode", keyword("RT")),
        Setting("ACQuire:INTERPEightbit", "interpolation", keyword("AUTO", "OFF")),
        Setting("ACQuire:SYNcsamples", "synchronous_samples", keyword("OFF")),
        Setting("ACQuire:ENHANCEDEnob", "enhanced_enob", keyword("OFF")),
        Query("ACQuire:NUMACq?", "count_acquisitions"),
        Query("BUSY?", "busy"),
        Setting("OPCEXtended", "extended_completion", boolean),
        Setting("FASTAcq:STATE", "not_fitted", boolean),
        Setting("HORizontal:FASTframe:STATE", "not_fitted", boolean),
        *TRANSFER_COMMANDS,
        Action("CLEAR", "forget_acquisitions", keyword("ALL")),
        Setting("DISplay:WAVEform", "display_on", boolean),
        Setting("LOCk", "panel_lock", keyword("ALL", "NONe")),
        Action("UNLock", "unlock_panel", keyword("ALL")),
    )

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.status: EventStatus = EventStatus()
        self.verbose = True
        self.clears_at_power_on = True
        self.display_on = True
        self.panel_lock = "NONe"
        self.reset()

    def reset(self) -> None:
        """`*RST`: factory settings, but headers, verbosity and masks stay as they are."""
        self.channels = {number: Channel(selected=number == 1) for number in CHANNELS.values()}
        self.horizontal = Horizontal()
        self.trigger = Trigger()
        self.transfer = Transfer()
        self.stop_after = "RUNSTop"
        self.acquisition_mode = "SAMple"
        self.averages = 16
        self.sampling_mode = "RT"
        self.interpolation = "AUTO"
        self.synchronous_samples = self.enhanced_enob = "OFF"
        self.extended_completion = False
        self._running = False
        self._acquired = 0
        self._traces: dict[int, Trace] = {}

    def restore_factory_settings(self) -> None:
        """`FACtory`: as `*RST`, and replies with headers and long words."""
        self.reset()
        self.headers = self.verbose = True

    # --- acquisition

    @property
    def acquiring(self) -> bool:
        """Whether the acquisition system runs; setting it starts a new acquisition or stops."""
        self.pending()
        return self._running

    @acquiring.setter
    def acquiring(self, run: bool) -> None:
        if not run and self._running and self.stop_after == "RUNSTop":
            self._acquire()  # the screen has shown acquisitions until now: the last one stays
        self._running = run
        if run:
            self._acquired = 0
            self.world.clock.advance(ARM_S)
            self.pending()

    def pending(self) -> bool:
        """Whether a single acquisition waits for its triggers; takes it if they come."""
        if self._running and self.stop_after == "SEQuence" and self._acquire():
            self._running = False
        return self._running and self.stop_after == "SEQuence"

    def waiting_for_trigger(self) -> bool:
        """`TRIGger:A:READY?`."""
        return self.pending()

    def trigger_state(self) -> str:
        """`TRIGger:STATE?`: what the front panel shows."""
        if self.pending():
            return "READY"
        return "TRIGGER" if self._running else "SAVE"

    def force_trigger(self, _word: str) -> None:
        """`TRIGger FORCe`: take what is there now, if an acquisition waits."""
        if self.pending():
            self._take(self._untriggered())
            self._running = False

    def _acquire(self) -> bool:
        """Take an acquisition with the triggers that come; False if none will."""
        times = self.world.next_triggers(self.trigger.condition, self._frames, self._spacing)
        if times is None:
            if self.trigger.mode == "NORMal":
                return False
            self.world.clock.advance(AUTO_TRIGGER_S)
            times = self._untriggered()
        self._take(times)
        return True

    @property
    def _frames(self) -> int:
        return self.averages if self.acquisition_mode == "AVErage" else 1

    @property
    def _spacing(self) -> float:
        """Least time between two triggers (s)."""
        holdoff = self.trigger.holdoff_s if self.trigger.holdoff_by == "TIMe" else 0.0
        return max(holdoff, self.horizontal.record_length / self.horizontal.sample_rate + REARM_S)

    def _untriggered(self) -> NDArray[np.float64]:
        return self.world.clock.now + self._spacing * np.arange(self._frames, dtype=np.float64)

    def _take(self, times: NDArray[np.float64]) -> None:
        """Record and digitise every selected channel after each of `times`."""
        acquisition = self._acquisition
        self._traces = {}
        if acquisition.channels:
            verticals = [self.channels[number].vertical for number in acquisition.channels]
            codes, offset_s = self._digitised(acquisition, times, verticals)
            at = self.horizontal.trigger_sample
            for number, row, vertical in zip(acquisition.channels, codes, verticals, strict=True):
                self._traces[number] = Trace(number, row, acquisition, at, offset_s, vertical)
        self._acquired += len(times)
        end_s = float(times[-1]) + acquisition.start_s + acquisition.samples / acquisition.sample_rate
        self.world.clock.advance(max(0.0, end_s - self.world.clock.now))

    @property
    def _acquisition(self) -> Acquisition:
        """What the present settings sample."""
        rate = self.horizontal.sample_rate
        return Acquisition(
            channels=tuple(number for number, channel in self.channels.items() if channel.selected),
            sample_rate=rate,
            samples=self.horizontal.record_length,
            start_s=-self.horizontal.trigger_sample / rate,
        )

    def _digitised(
        self, acquisition: Acquisition, times: NDArray[np.float64], verticals: list[Vertical]
    ) -> tuple[Codes, float]:
        """Codes (channels, samples) and the mean trigger offset (s); averages keep 16 bits: 256 times the mean."""
        setting = b"".join(struct.pack("<3d?", *vertical) for vertical in verticals)
        if self.acquisition_mode != "AVErage":
            record = self.world.record(acquisition, times, setting=setting)
            return self._codes(record, 0, verticals), float(record.trigger_offset_s[0])
        total = np.zeros((len(verticals), acquisition.samples), np.int32)
        offset_s = 0.0
        for batch in np.array_split(times, ceil(times.size / TRIGGERS_AT_ONCE)):
            record = self.world.record(acquisition, batch, setting=setting)
            for trigger in range(batch.size):
                total += self._codes(record, trigger, verticals)
            offset_s += float(record.trigger_offset_s.sum())
        return np.rint(total * (256 / times.size)).astype(np.int16), offset_s / times.size

    def _codes(self, record: Record, trigger: int, verticals: list[Vertical]) -> NDArray[np.int8]:
        """Codes (channels, samples) of one trigger; neighbours with equal settings are digitised together."""
        began = perf_counter()
        noise = record.frame_noise(trigger)
        parts = []
        first = 0
        for vertical, alike in groupby(verticals):
            last = first + len(list(alike))
            volts = record.volts[trigger, first:last]
            parts.append(
                receiver.digitise(
                    -volts if vertical.inverted else volts,
                    scale_v_per_div=vertical.scale_v,
                    offset_v=vertical.offset_v,
                    position_div=vertical.position_div,
                    enob=self.world.parameters.enob,
                    generator=noise,
                )
            )
            first = last
        codes = parts[0] if len(parts) == 1 else np.concatenate(parts)
        self.world.physics_seconds += perf_counter() - began
        return codes

    def forget_acquisitions(self, _word: str) -> None:
        """`CLEAR ALL`."""
        self._traces = {}
        self._acquired = 0

    def count_acquisitions(self) -> int:
        """`ACQuire:NUMACq?`: triggers since RUN."""
        self.pending()
        return self._acquired

    def busy(self) -> bool:
        """`BUSY?`."""
        return self.acquiring

    @property
    def actual_mode(self) -> str:
        """The mode really used: peak detection and high resolution need a lower rate than any here, SAMple it is."""
        return "AVErage" if self.acquisition_mode == "AVErage" else "SAMple"

    # --- transfer

    def initialise_transfer(self, _word: str) -> None:
        """`DATa INIT`: factory settings of the transfer."""
        self.transfer = Transfer()

    @property
    def preamble(self) -> Preamble:
        """The preamble of the first source; before its first acquisition, of what the settings lead to expect."""
        self.pending()
        number = CHANNELS[self.transfer.sources[0]]
        expected = Trace(
            number, NO_CODES, self._acquisition, self.horizontal.trigger_sample, 0.0, self.channels[number].vertical
        )
        return Preamble(self._traces.get(number, expected), self.transfer)

    def whole_preamble(self) -> str:
        """`WFMOutpre?`: every field in order; with headers on, each behind its name."""
        fields = [setting.answer(self, (), ()) for setting in PREAMBLE]
        if self.headers:
            headers = [reply_header(setting, (), verbose=self.verbose) for setting in PREAMBLE]
            names = [headers[0], *(header.rpartition(":")[2] for header in headers[1:])]
            fields = [f"{name} {field}" for name, field in zip(names, fields, strict=True)]
        return ";".join(fields)

    def curve(self) -> list[Chunk]:
        """`CURVe?`: the points of every source; 2244 if one is off, 2241 if there is nothing to send.

        While the oscilloscope runs freely, each transfer begins with a new acquisition.
        """
        numbers = [CHANNELS[source] for source in self.transfer.sources]
        for number in numbers:
            if not self.channels[number].selected:
                raise ScpiError(2244, f"CH{number}")
        if not self.pending() and self._running:
            self._acquire()
        reply: list[Chunk] = []
        for number in numbers:
            if number not in self._traces:
                raise ScpiError(2241, f"CH{number}: nothing acquired")
            reply += [b",", *self._traces[number].curve(self.transfer)]
        self.world.clock.advance(READ_S)
        return reply[1:]

    # --- the rest

    def changed(self) -> None:
        """With more than two channels on, the highest sample rate is shared out."""
        shared = sum(channel.selected for channel in self.channels.values()) > 2
        self.horizontal.highest_rate = RATES[1] if shared else RATES[0]

    def short_identity(self) -> str:
        """`ID?`: the identity without the serial number."""
        maker, model, _, firmware = self.IDENTITY.split(",")
        return f"{maker},{model},{firmware}"

    @property
    def not_fitted(self) -> bool:
        """FastAcq and FastFrame are off and stay off: -221."""
        return False

    @not_fitted.setter
    def not_fitted(self, wanted: bool) -> None:
        if wanted:
            raise ScpiError(-221, "FastAcq and FastFrame are not fitted")

    def unlock_panel(self, _word: str) -> None:
        """`UNLock ALL`."""
        self.panel_lock = "NONe"
