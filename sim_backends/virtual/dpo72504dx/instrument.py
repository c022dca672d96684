"""The virtual real-time oscilloscope: arming, acquisition, events, and what clients read of them.

Source: instrument facts 2.1 to 2.10. Not simulated: cursors, histograms, pixel maps (FastAcq, waveform database),
equivalent time, and whatever else `docs/reference/not-simulated.md` lists.
"""

from importlib.resources import files
from typing import ClassVar

import numpy as np

from sim_backends.scpi.arguments import boolean, integer, keyword, run_or_stop
from sim_backends.scpi.commands import Action, Query, Setting
from sim_backends.scpi.family import Family
from sim_backends.scpi.messages import Chunk, parse
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.dpo72504dx.autoset import AUTOSET_COMMANDS, Autoset
from sim_backends.virtual.dpo72504dx.measurements import NO_WAVEFORM, Waveform
from sim_backends.virtual.dpo72504dx.measuring import MEASUREMENT_COMMANDS, SLOTS, Measuring
from sim_backends.virtual.dpo72504dx.setups import SETUP_COMMANDS, Setups, learned, readings, told
from sim_backends.virtual.dpo72504dx.storage import STORAGE_COMMANDS, Storage
from sim_backends.virtual.oscilloscope.acquisition import AcquisitionSystem
from sim_backends.virtual.oscilloscope.fastframe import FASTFRAME_COMMANDS, Stamps
from sim_backends.virtual.oscilloscope.horizontal import HORIZONTAL_COMMANDS, RECORDS
from sim_backends.virtual.oscilloscope.mathematics import WAVEFORM_COMMANDS
from sim_backends.virtual.oscilloscope.modes import MODE_COMMANDS
from sim_backends.virtual.oscilloscope.transfer import PREAMBLE, TRANSFER_COMMANDS, Transfer
from sim_backends.virtual.oscilloscope.trigger import TRIGGER_COMMANDS
from sim_backends.virtual.oscilloscope.vertical import BANDWIDTH_HZ, VERTICAL_COMMANDS
from sim_backends.world.world import World


class VirtualDpo72504dx(AcquisitionSystem):
    """What a client of a DPO72504DX can see: its settings, its records, its events."""

    IDENTITY = "TEKTRONIX,DPO72504DX,SIM0001,CF:91.1CT FV:10.8.3 Build 3"
    OPTIONS = "STD:Standard record length"
    SUFFIXES: ClassVar = {"CH": 4, "MATH": 4, "REF": 4, "MEAS": SLOTS, "SOUrce": 2, "EDGE": 2, "MID": 2}
    FAMILY = Family(files(__package__).joinpath("family.txt").read_text(encoding="utf-8"), suffix_required=True)
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
        Setting("*PSC", "clears_at_power_on", boolean, effect=False),
        Action("FACtory", "restore_factory_settings"),
        *VERTICAL_COMMANDS,
        *HORIZONTAL_COMMANDS,
        *FASTFRAME_COMMANDS,
        *TRIGGER_COMMANDS,
        Action("TRIGger", "force_trigger", keyword("FORCe")),
        Query("TRIGger:STATE?", "trigger_state"),
        Query("TRIGger:A:READY?", "waiting_for_trigger"),
        Setting(
            "AUXout:SOUrce",
            "output_source",
            keyword("ATRIGger", "BTRIGger", "DELayed", "EVENT", "REFOUT"),
            effect=False,
        ),
        Setting("AUXout:EDGE", "output_edge", keyword("RISing", "FALling"), effect=False),
        Setting("ACQuire:STATE", "acquiring", run_or_stop),
        *MODE_COMMANDS,
        Query("ACQuire:NUMACq?", "count_acquisitions"),
        Query("ACQuire:NUMFRAMESACQuired?", "count_frames"),
        Query("BUSY?", "busy"),
        Setting("OPCEXtended", "extended_completion", boolean, effect=False),
        Setting("FASTAcq:STATE", "pixel_maps", boolean),
        *TRANSFER_COMMANDS,
        *WAVEFORM_COMMANDS,
        *MEASUREMENT_COMMANDS,
        *SETUP_COMMANDS,
        *STORAGE_COMMANDS,
        *AUTOSET_COMMANDS,
        Action("CLEAR", "forget_acquisitions", keyword("ALL")),
        Setting("DISplay:WAVEform", "display_on", boolean, effect=False),
        Setting("LOCk", "panel_lock", keyword("ALL", "NONe"), effect=False),
        Action("UNLock", "unlock_panel", keyword("ALL"), effect=False),
    )

    PLANNED_BY = frozenset(
        (*VERTICAL_COMMANDS, *HORIZONTAL_COMMANDS, *FASTFRAME_COMMANDS, *TRIGGER_COMMANDS, *MODE_COMMANDS)
    )
    RECORDS = RECORDS
    FULL_BANDWIDTH_HZ = BANDWIDTH_HZ
    BITS = 8

    def __init__(self, world: World) -> None:
        super().__init__(world, effective_bits=world.parameters.enob)
        self.stamps = Stamps(lambda: self.frames, self.acquired_trace)
        self.setups = Setups(lambda: learned(self), self.obey)
        self.storage = Storage(self.setups, self.acquired, self.references, self.reset)
        self.autoset = Autoset(self)
        self.reset()

    def reset(self) -> None:
        """`*RST`: factory settings, but headers, verbosity and masks stay as they are."""
        super().reset()
        self.measuring = Measuring(self)
        self.enhances_all = False
        self.output_source, self.output_edge = "ATRIGger", "RISing"
        self.extended_completion = False

    # --- acquisition

    def waiting_for_trigger(self) -> bool:
        """`TRIGger:A:READY?`: whether a trigger would have been taken when the query came."""
        waiting = self._running and self.mode.stop_after == "SEQuence"
        self.pending()
        return waiting if self.frames.on else self._running and waiting

    # --- transfer

    def preset_transfer(self, word: str) -> None:
        """`DATa INIT`: factory settings of the transfer, but the whole record; `SNAp`: all points, without cursors."""
        if word == "INIT":
            self.transfer = Transfer()
        self.transfer.start, self.transfer.stop = 1, self.horizontal.record_length

    def whole_preamble(self) -> str:
        """`WFMOutpre?`: every field in order; with headers on, each behind its name."""
        return told(readings(self, PREAMBLE), headers=self.headers)

    def lacks_new(self) -> bool:
        """Whether every acquisition was sent already, and none will be taken on demand."""
        return self.pending() or (self._sent_new and not self._running)

    def preamble_and_curve(self) -> list[Chunk]:
        """`WAVFrm?`, `WAVFRMStream?`: `WFMOutpre?` and `CURVe?` in one reply."""
        curve = self.curve()
        header = (":CURVE " if self.verbose else ":CURV ") if self.headers else ""
        return [f"{self.whole_preamble()};{header}".encode("latin-1"), *curve]

    # --- measurements and setups

    def measured_waveform(self, source: str) -> Waveform:
        """What a measurement of `source` looks at, of FastFrame the selected frame; 2225 if there is nothing."""
        if not self.shown(source):
            raise ScpiError(NO_WAVEFORM, source)
        try:
            trace = self.acquired(source)
        except ScpiError:
            raise ScpiError(NO_WAVEFORM, source) from None
        selected = self.frames.selected[trace.channel].frame if trace.channel else 1
        frame = min(selected, trace.codes.shape[0]) - 1
        points = np.asarray(trace.physical()[frame], np.float64)
        return Waveform(points, trace.start_s, trace.step_s, trace.unit)

    def obey(self, text: str) -> None:
        """Execute commands of its own, of which none waits; what they are refused is reported."""
        for _ in self.run(parse(text.encode("latin-1"), [])):
            raise AssertionError(text)
