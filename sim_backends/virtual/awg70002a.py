"""The virtual arbitrary waveform generator: clock, assignment, run control, and what channel 1 does to the light.

Source: instrument facts 1.1 to 1.10. Not simulated: sequences, files, the function generator.
"""

from typing import ClassVar

import numpy as np

from sim_backends.scpi.arguments import boolean, keyword, optional, quoted, real
from sim_backends.scpi.commands import Action, Query, Setting
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg_channels import CHANNEL_COMMANDS, TRIGGER_INPUT, Source, TriggerInput
from sim_backends.virtual.instrument import ERROR_QUEUE, VirtualInstrument
from sim_backends.virtual.waveforms import MARKER_1, SHORTEST, WAVEFORM_COMMANDS, Waveform, WaveformList, calendar
from sim_backends.world import Playback, World

SAMPLE_RATE = real(1.49e3, 25e9)  # S/s
RUN_MODE = keyword("CONTinuous", "TRIGgered", "TCONtinuous")
RUN_TIME_S = 1.0  # recalled: the outputs settle for about a second after RUN


class VirtualAwg70002a(VirtualInstrument):
    """What a client of an AWG70002A can see: its state, its replies, its errors, and what it does to the light."""

    IDENTITY = "TEKTRONIX,AWG70002A,SIM0001,FV:6.1.0123"
    OPTIONS = "225"
    SUFFIXES: ClassVar = {"SOURce": 2, "OUTPut": 2, "MARKer": 2}
    COMMANDS = (
        Setting("CLOCk:SRATe", "sample_rate", SAMPLE_RATE),
        Setting("SOURce#:FREQuency", "sample_rate", SAMPLE_RATE),
        Setting("CLOCk:SOURce", "clock_source", keyword("INTernal", "EFIXed", "EVARiable", "EXTernal")),
        Setting("CLOCk:ECLock:FREQuency", "external_clock_hz", real(6.25e9, 12.5e9)),
        Setting("CLOCk:OUTPut[:STATe]", "clock_output", boolean),
        Setting("CLOCk:SOUT[:STATe]", "sync_clock_output", boolean),
        *WAVEFORM_COMMANDS,
        Query("SLISt:SIZE?", "count_sequences"),
        Action("SOURce#:CASSet:WAVeform", "assign", quoted),
        Action("SOURce#:WAVeform", "assign", quoted),
        Query("SOURce#:WAVeform?", "assigned"),
        Query("SOURce#:CASSet?", "assigned"),
        Query("SOURce#:CASSet:TYPE?", "assigned_type"),
        Action("SOURce#:CASSet:CLEar", "unassign"),
        *CHANNEL_COMMANDS,
        Setting("OUTPut:OFF", "outputs_off", boolean),
        Action("AWGControl:RUN[:IMMediate]", "start"),
        Action("AWGControl:STOP[:IMMediate]", "stop"),
        Query("AWGControl:RSTate?", "run_state"),
        Action("SOURce#:RMODe", "set_run_mode", RUN_MODE),
        Setting("SOURce#:RMODe?", "sources#.run_mode", RUN_MODE),
        Setting("AWGControl:RMODe", "run_mode", keyword("CONTinuous", "TRIGgered")),
        Setting("SOURce:RCCouple", "run_modes_coupled", boolean),
        Setting("AWGControl:ARSettings", "apply_recommended_settings", boolean),
        Query("AWGControl:CONFigure:CNUMber?", "count_channels"),
        Action("TRIGger[:SEQuence][:IMMediate]", "trigger", optional(TRIGGER_INPUT)),
        Setting("TRIGger[:SEQuence]:SOURce", "trigger_source", keyword("EXTernal", "INTernal")),
        Setting("TRIGger[:SEQuence]:INTerval", "trigger_interval_s", real(1e-6, 10)),
        Setting("INSTrument:MODE", "mode", keyword("AWG")),
        Setting("INSTrument:COUPle:SOURce", "sources_coupled", boolean),
        Setting("MMEMory:CDIRectory", "directory", quoted),
        *ERROR_QUEUE,
        Setting("SYSTem:ERRor:DIALog", "error_dialog", boolean),
        Query("SYSTem:VERSion?", "scpi_version"),
        Query("SYSTem:DATE?", "date"),
        Query("SYSTem:TIME?", "time_of_day"),
    )

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._playing: tuple[object, ...] | None = None
        self.directory = "C:\\"
        self.reset()

    def reset(self) -> None:
        """`*RST`: the state of instrument facts 1.9; the waveform list is emptied."""
        self.sample_rate = 25e9
        self.clock_source = "INTernal"
        self.external_clock_hz = 6.25e9
        self.clock_output = self.sync_clock_output = False
        self.waveforms = WaveformList(self.world.clock)
        self.sources = {number: Source(number) for number in (1, 2)}
        self.inputs = {name: TriggerInput() for name in ("ATRigger", "BTRigger")}
        self.trigger_source = "EXTernal"
        self.trigger_interval_s = 1e-3
        self.outputs_off = self.running = self.triggered = False
        self.run_modes_coupled = self.sources_coupled = self.apply_recommended_settings = False
        self.mode = "AWG"
        self.error_dialog = True

    # --- what comes out of channel 1

    def changed(self) -> None:
        """Let go of deleted waveforms, and tell the world when the playback of channel 1 has changed."""
        for source in self.sources.values():
            if source.waveform is not None and source.waveform not in self.waveforms:
                source.waveform = None
                source.output = source.output and not self.running
                self.stop()
        source, waveform = self.sources[1], self.sources[1].waveform
        playing: tuple[object, ...] | None = None
        if waveform and source.output and not self.outputs_off and self.run_state() == 2:
            marker = source.markers[1]
            levels = (source.amplitude_v, source.dac_bits, marker.low_v, marker.high_v)
            playing = (waveform, waveform.version, self.sample_rate, *levels)
        if playing != self._playing:
            self._playing = playing
            self.world.play(self._playback(source, waveform) if waveform and playing else None)

    def _playback(self, source: Source, waveform: Waveform) -> Playback:
        """One period of channel 1; with all 10 bits in use the DAC has none left for the marker."""
        marker = waveform.markers & MARKER_1 != 0 if source.dac_bits < 10 else np.zeros(waveform.length, np.bool_)
        return Playback(
            volts=waveform.converted(source.dac_bits) * np.float32(source.amplitude_v / 2),
            marker=marker,
            marker_low_v=source.markers[1].low_v,
            marker_high_v=source.markers[1].high_v,
            sample_rate=self.sample_rate,
        )

    # --- run control

    def start(self) -> None:
        """`AWGControl:RUN`: -221 with nothing assigned."""
        if not any(source.waveform for source in self.sources.values()):
            raise ScpiError(-221, "nothing is assigned to a channel")
        self.running, self.triggered = True, False
        self.world.clock.advance(RUN_TIME_S)

    def stop(self) -> None:
        """`AWGControl:STOP`."""
        self.running = self.triggered = False

    def run_state(self) -> int:
        """0 stopped, 1 waiting for a trigger, 2 running."""
        if not self.running:
            return 0
        mode = self.sources[1].run_mode
        return 2 if mode == "CONTinuous" or (mode == "TCONtinuous" and self.triggered) else 1

    def trigger(self, name: str | None = None) -> None:
        """A trigger at an input (A if none is named): triggered continuous playback begins.

        In triggered mode a single cycle comes out, which is over before anything else can look.
        """
        if self.running and self.sources[1].trigger_input == (name or "ATRigger"):
            self.triggered = True

    def bus_trigger(self) -> None:
        """`*TRG`: a trigger at input A."""
        self.trigger()

    def set_run_mode(self, number: int, mode: str) -> None:
        """Run mode of one channel, or of both when they are coupled."""
        for source in self.sources.values() if self.run_modes_coupled else (self.sources[number],):
            source.run_mode = mode

    @property
    def run_mode(self) -> str:
        """Run mode of channel 1."""
        return self.sources[1].run_mode

    @run_mode.setter
    def run_mode(self, mode: str) -> None:
        self.set_run_mode(1, mode)

    # --- assignment

    def assign(self, number: int, name: str) -> None:
        """Put a waveform on a channel: -224 unknown, -222 too short."""
        waveform = self.waveforms[name]
        if waveform.length < SHORTEST:
            raise ScpiError(-222, f"{name} has {waveform.length} points, {SHORTEST} are the least")
        self.sources[number].waveform = waveform

    def unassign(self, number: int) -> None:
        """Take the waveform off a channel."""
        self.sources[number].waveform = None

    def assigned(self, number: int) -> str:
        """Name of the channel's waveform, quoted."""
        waveform = self.sources[number].waveform
        return quoted.format(waveform.name if waveform else "", verbose=False)

    def assigned_type(self, number: int) -> str:
        """WAV or NONE."""
        return "WAV" if self.sources[number].waveform else "NONE"

    # --- system

    def count_sequences(self) -> int:
        """No sequencer is fitted."""
        return 0

    def count_channels(self) -> int:
        """Two."""
        return len(self.sources)

    def scpi_version(self) -> str:
        """SCPI version the instrument follows."""
        return "1999.0"

    def date(self) -> str:
        """Date by the virtual clock."""
        return f"{calendar(self.world.clock.now):%Y,%m,%d}"

    def time_of_day(self) -> str:
        """Time by the virtual clock."""
        return f"{calendar(self.world.clock.now):%H,%M,%S}"
