"""The virtual arbitrary waveform generator: assignment, run control, and what channel 1 does to the light.

Source: instrument facts 1.1 to 1.10; how long the self-test takes is recalled: the vendor's public test framework
(tektronix/lab-bot) waits 20 minutes for `*TST?`, which is the power-on self-test. The level that an output holds while
it waits for a trigger is 0 V and marker low whatever `OUTPut:WVALue` says; correction files are refused; flag outputs
and channel 2 do not reach the light.
"""

import math
from importlib.resources import files
from typing import ClassVar

import numpy as np

from sim_backends.scpi.arguments import boolean, integer, keyword, number_or_word, optional, quoted, real
from sim_backends.scpi.commands import Action, Command, Query, Setting
from sim_backends.scpi.family import Family
from sim_backends.scpi.messages import parse
from sim_backends.scpi.registers import FREQUENCY, STATUS_COMMANDS, WAITING_FOR_TRIGGER, RegisterStatus
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a import setups
from sim_backends.virtual.awg70002a.basic_waveform import BASIC_COMMANDS, BasicWaveform
from sim_backends.virtual.awg70002a.calendar import CALENDAR_COMMANDS, Calendar
from sim_backends.virtual.awg70002a.channels import CHANNEL_COMMANDS, TRIGGER_INPUT, Source, TriggerInput
from sim_backends.virtual.awg70002a.clock import CLOCK_COMMANDS, Timing
from sim_backends.virtual.awg70002a.files import FILE_COMMANDS, MassMemory
from sim_backends.virtual.awg70002a.function_generator import FUNCTION_COMMANDS, Function, SharedFrequency
from sim_backends.virtual.awg70002a.output import played_function, played_schedule
from sim_backends.virtual.awg70002a.player import INTERNAL, RUNNING, STOPPED, WAITING, Player, playable
from sim_backends.virtual.awg70002a.sequences import MOST_STEPS, SEQUENCE_COMMANDS, SequenceList
from sim_backends.virtual.awg70002a.waveforms import AMPLITUDES_V, RATES, WAVEFORM_COMMANDS, WaveformList
from sim_backends.virtual.awg70002a.wfmx import WaveformFile
from sim_backends.virtual.instrument import ERROR_QUEUE, VirtualInstrument
from sim_backends.world.signals import Playback
from sim_backends.world.world import World

RUN_MODE = keyword("CONTinuous", "TRIGgered", "TCONtinuous")
CHANNEL_INPUT = keyword("ITRigger", "ATRigger", "BTRigger")
COMPONENT = keyword("I", "Q", "IQ")
JUMP = number_or_word(1, MOST_STEPS, "FIRSt", "CURRent", "LAST", "END")
INTERVALS_S = (1e-6, 10.0)  # recalled
RUN_TIME_S = 1.0  # recalled: the outputs settle for about a second after RUN
POLL_S = 0.1  # what a query takes while an operation is under way
SELF_TEST_S = 300.0


class VirtualAwg70002a(VirtualInstrument):
    """What a client of an AWG70002A can see: its state, its replies, its errors, and what it does to the light."""

    IDENTITY = "TEKTRONIX,AWG70002A,SIM0001,FV:6.1.0123"
    OPTIONS = "03,225"
    FAMILY = Family(files(__package__).joinpath("family.txt").read_text(encoding="utf-8"), suffix_required=False)
    SUFFIXES: ClassVar = {
        "SOURce": 2,
        "OUTPut": 2,
        "MARKer": 2,
        "CHANnel": 2,
        "STEP": MOST_STEPS,
        "TASSet": 99,
        "TFLag": 99,
    }
    status: RegisterStatus
    COMMANDS = (
        *CLOCK_COMMANDS,
        *WAVEFORM_COMMANDS,
        Setting("WLISt:WAVeform:ACFile:RSINc", "removes_sinc", boolean, effect=False),
        Action("WLISt:WAVeform:ACFile", "correct", quoted, quoted, optional(quoted)),
        *SEQUENCE_COMMANDS,
        *FILE_COMMANDS,
        Action("MMEMory:SAVE:SETup", "save_setup", quoted, optional(boolean)),
        Action("MMEMory:OPEN:SETup", "open_setup", quoted),
        Action("AWGControl:SSAVe", "save_all", quoted, optional(quoted)),
        Action("AWGControl:SREStore", "restore", quoted, optional(quoted)),
        Setting("AWGControl:SNAMe?", "setup_name", quoted),
        *BASIC_COMMANDS,
        *FUNCTION_COMMANDS,
        Action("[SOURce#:]CASSet:WAVeform", "assign", quoted, optional(COMPONENT)),
        Action("[SOURce#:]CASSet:SEQuence", "assign_sequence", quoted, integer(1, 99), optional(COMPONENT)),
        Action("[SOURce#:]WAVeform", "assign", quoted),
        Query("[SOURce#:]WAVeform?", "assigned_waveform"),
        Query("[SOURce#:]CASSet?", "assigned"),
        Query("[SOURce#:]CASSet:TYPE?", "assigned_type"),
        Action("[SOURce#:]CASSet:CLEar", "unassign"),
        *CHANNEL_COMMANDS,
        Action("[SOURce#:]TINPut", "set_trigger_input", CHANNEL_INPUT),
        Query("[SOURce#:]SCSTep?", "current_step"),
        Action("[SOURce#:]JUMP:FORCe", "jump", JUMP),
        Setting("OUTPut:OFF", "outputs_off", boolean),
        Action("AWGControl:RUN[:IMMediate]", "start"),
        Action("AWGControl:STOP[:IMMediate]", "stop"),
        Query("AWGControl:RSTate?", "run_state"),
        Action("[SOURce#:]RMODe", "set_run_mode", RUN_MODE),
        Setting("[SOURce#:]RMODe?", "sources#.run_mode", RUN_MODE),
        Setting("AWGControl:RMODe", "run_mode", keyword("CONTinuous", "TRIGgered")),
        Setting("AWGControl:RMODe?", "run_mode", RUN_MODE),
        Setting("[SOURce:]RCCouple", "run_modes_coupled", boolean),
        Setting("AWGControl:ARSettings", "apply_recommended_settings", boolean),
        Query("AWGControl:CONFigure:CNUMber?", "count_channels"),
        Action("TRIGger[:SEQuence][:IMMediate]", "trigger", optional(TRIGGER_INPUT)),
        Setting("TRIGger[:SEQuence]:SOURce", "trigger_source", keyword("EXTernal", "INTernal")),
        Setting("TRIGger[:SEQuence]:INTerval", "trigger_interval_s", real(*INTERVALS_S)),
        Setting("INSTrument:MODE", "mode", keyword("AWG", "FGEN")),
        Setting("INSTrument:COUPle:SOURce", "sources_coupled", boolean),
        *ERROR_QUEUE,
        *STATUS_COMMANDS,
        Setting("SYSTem:ERRor:DIALog", "error_dialog", boolean, effect=False),
        Query("SYSTem:VERSion?", "scpi_version"),
        *CALENDAR_COMMANDS,
    )

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.status = RegisterStatus(self._operation, self._questionable)
        self.setup_name = ""
        self.basic = BasicWaveform()
        self._playing: tuple[object, ...] | None = None
        self._listening: tuple[float, bool] | None = None
        self.calendar = Calendar(world.clock)
        self._done_s = 0.0
        self.files = MassMemory(world.clock)
        self.reset()

    def reset(self) -> None:
        """`*RST`: the state of instrument facts 1.9; both lists are emptied, the files stay."""
        self.timing = Timing()
        self.waveforms = WaveformList(self.world.clock)
        self.sequences = SequenceList(self.waveforms)
        self.files.reset(self.waveforms, self.sequences)
        self.sources = {number: Source(number) for number in (1, 2)}
        self.players = {number: Player(source, self.world.clock) for number, source in self.sources.items()}
        self.inputs = {name: TriggerInput() for name in ("ATRigger", "BTRigger")}
        frequency = SharedFrequency()
        self.functions = {number: Function(frequency) for number in self.sources}
        self.basic.reset()
        self.trigger_source = "EXTernal"
        self.trigger_interval_s = 1e-3
        self.outputs_off = self.running = False
        self._run_modes_coupled = self.sources_coupled = self.apply_recommended_settings = False
        self.removes_sinc = False
        self.mode = "AWG"
        self.error_dialog = True

    # --- overlapping operations

    def pending(self) -> bool:
        """Whether RUN has not settled yet."""
        return self.world.clock.now < self._done_s

    def prepare(self, command: Command, *, query: bool) -> None:
        """Let virtual time pass while a client waits: to the end for `*OPC?` and `*WAI`, a little for other queries."""
        left = self._done_s - self.world.clock.now
        if left > 0 and (command.waits or query):
            self.world.clock.advance(left if command.waits else min(left, POLL_S))

    # --- what comes out of channel 1

    def changed(self, _command: Command) -> None:
        """Let go of deleted assets, note events, and pass on what has changed of channel 1's playback and trigger."""
        for source in self.sources.values():
            gone = source.waveform is not None and source.waveform not in self.waveforms
            if gone or (source.sequence is not None and source.sequence not in self.sequences):
                source.clear()
                source.output = source.output and not self.running
                self.stop()
        if self.sources_coupled:
            self.sources[2].couple(self.sources[1])
        if self.running and self.mode == "AWG":
            self._arrange()
        playing = self._output_key()
        if playing != self._playing:
            self._playing = playing
            self.world.play(self._playback() if playing else None)
        entrance = self.inputs["ATRigger"]
        level = entrance.open_level_v if self.players[1].external else math.inf
        self.status.look()
        if self._listening != (level, entrance.slope == "POSitive"):
            self._listening = level, entrance.slope == "POSitive"
            self.world.awg_trigger_level(level, rising=self._listening[1])

    def _arrange(self) -> None:
        """Compile what the channels play; what cannot be played any more ends the run."""
        try:
            for number, player in self.players.items():
                player.arrange(self.waveforms, self.sequences, self._trigger_input(number))
        except ScpiError as error:
            self.stop()
            self.status.report(error)

    def _trigger_input(self, number: int) -> str:
        return INTERNAL if self.trigger_source == "INTernal" else self.sources[number].trigger_input

    def _output_key(self) -> tuple[object, ...] | None:
        """Differs whenever something else comes out of channel 1; None: nothing does."""
        source, found = self.sources[1], self.players[1].schedule
        if not (self.running and source.output) or self.outputs_off or self.timing.missing:
            return None
        if self.mode == "FGEN":
            return (*self.functions[1].key(), source.skew_s)
        if found is None:
            return None
        marker = source.markers[1]
        levels = (source.amplitude_v, source.dac_bits, marker.low_v, marker.high_v, marker.delay_s, source.skew_s)
        data = tuple({item.waveform: item.waveform.version for part in found.segments for item in part}.items())
        return (found, data, self.timing.sample_rate, self.trigger_interval_s, *levels)

    def _playback(self) -> Playback:
        source, found = self.sources[1], self.players[1].schedule
        if self.mode == "FGEN" or found is None:
            return played_function(self.functions[1], source, self.world.generator("function generator", "noise"))
        return played_schedule(found, source, self.timing.sample_rate, self.trigger_interval_s)

    # --- run control

    def start(self) -> None:
        """`AWGControl:RUN`: -221 with nothing assigned or a step of a sequence empty, -241 without a clock.

        Overlapping: `*OPC?` waits.
        """
        self.timing.require()
        if self.mode == "AWG":
            if not any(source.assigned for source in self.sources.values()):
                raise ScpiError(-221, "nothing is assigned to a channel")
            for number, player in self.players.items():
                player.begin()
                player.arrange(self.waveforms, self.sequences, self._trigger_input(number))
        self.running = True
        self._done_s = self.world.clock.now + RUN_TIME_S

    def stop(self) -> None:
        """`AWGControl:STOP`."""
        self.running = False

    def run_state(self) -> int:
        """0 stopped, 1 waiting for a trigger, 2 running."""
        if not self.running:
            return STOPPED
        if self.mode == "FGEN":
            return RUNNING
        return min((player.state() for player in self.players.values() if player.source.assigned), default=STOPPED)

    def trigger(self, name: str | None = None) -> None:
        """A trigger at an input, A if none is named."""
        if not self.running or self.mode != "AWG":
            return
        started = {n: p.trigger(name or "ATRigger", self.timing.sample_rate) for n, p in self.players.items()}
        if started[1]:
            self.world.trigger_awg()

    def bus_trigger(self) -> None:
        """`*TRG`: a trigger at input A."""
        self.trigger()

    def jump(self, number: int, where: int | str) -> None:
        """`JUMP:FORCe`: -221 unless a sequence runs."""
        if not self.running:
            raise ScpiError(-221, "no sequence runs")
        self.players[number].jump(where, self.timing.sample_rate)

    def current_step(self, number: int) -> int:
        """`SCSTep?`: the step that plays or waits; 0 while nothing runs."""
        return self.players[number].step(self.timing.sample_rate) if self.running else 0

    def set_run_mode(self, number: int, mode: str) -> None:
        """Run mode of one channel, or of both when they are coupled."""
        for source in self._coupled(number):
            source.run_mode = mode

    def set_trigger_input(self, number: int, name: str) -> None:
        """Trigger input of one channel, or of both when they are coupled."""
        for source in self._coupled(number):
            source.trigger_input = name

    def _coupled(self, number: int) -> list[Source]:
        return list(self.sources.values()) if self._run_modes_coupled else [self.sources[number]]

    @property
    def run_mode(self) -> str:
        """Run mode of channel 1."""
        return self.sources[1].run_mode

    @run_mode.setter
    def run_mode(self, mode: str) -> None:
        self.set_run_mode(1, mode)

    @property
    def run_modes_coupled(self) -> bool:
        """Whether both channels share run mode and trigger input; coupling them makes channel 2 follow channel 1."""
        return self._run_modes_coupled

    @run_modes_coupled.setter
    def run_modes_coupled(self, coupled: bool) -> None:
        self._run_modes_coupled = coupled
        if coupled:
            self.set_run_mode(1, self.sources[1].run_mode)
            self.set_trigger_input(1, self.sources[1].trigger_input)

    # --- assignment

    def assign(self, number: int, name: str, component: str | None = None) -> None:
        """Put a waveform on a channel: -224 unknown, -222 too short, -221 no such component."""
        waveform = playable(self.waveforms[name], name)
        waveform.component(component or "I")
        source = self.sources[number]
        source.clear()
        source.waveform, source.component = waveform, component or "I"
        self._recommend(source, waveform.sample_rate, waveform.amplitude_v)

    def assign_sequence(self, number: int, name: str, track: int, component: str | None = None) -> None:
        """Put a track of a sequence on a channel: -224 unknown, -222 no such track."""
        sequence = self.sequences[name]
        if track > sequence.tracks:
            raise ScpiError(-222, f"track {track} of {sequence.tracks}")
        source = self.sources[number]
        source.clear()
        source.sequence, source.track, source.component = sequence, track, component or "I"
        self._recommend(source, sequence.sample_rate, sequence.amplitude_v)

    def _recommend(self, source: Source, sample_rate: float, amplitude_v: float) -> None:
        """Apply what an asset recommends, as far as the instrument can (`AWGControl:ARSettings`)."""
        if self.apply_recommended_settings:
            low, high = AMPLITUDES_V
            if low <= amplitude_v <= high:
                source.amplitude_v = amplitude_v
            if RATES[0] <= sample_rate <= self.timing.highest_rate:
                self.timing.sample_rate = sample_rate

    def unassign(self, number: int) -> None:
        """Take the asset off a channel."""
        self.sources[number].clear()

    def assigned_waveform(self, number: int) -> str:
        """Name of the channel's waveform, quoted."""
        waveform = self.sources[number].waveform
        return quoted.format(waveform.name if waveform else "", verbose=False)

    def assigned(self, number: int) -> str:
        """Name of the channel's waveform, or of its sequence with the track, quoted."""
        source = self.sources[number]
        if source.sequence is not None:
            return quoted.format(f"{source.sequence.name},{source.track}", verbose=False)
        return self.assigned_waveform(number)

    def assigned_type(self, number: int) -> str:
        """WAV, SEQ or NONE."""
        source = self.sources[number]
        return "SEQ" if source.sequence else "WAV" if source.waveform else "NONE"

    # --- setups

    def save_setup(self, path: str, with_assets: bool | None) -> None:
        """Write the setup to a file, with waveforms and sequences unless it is told otherwise."""
        settings = "\n".join(setups.commands(self._answer, self.sources.values()))
        self.files.save_setup(path, settings, with_assets=with_assets is not False)
        self.setup_name = str(self.files.disk.path(path))

    def open_setup(self, path: str) -> None:
        """Restore a setup, outputs off; -256 no such file, -200 one that holds none."""
        found = self.files.setup(path)
        lines = setups.checked(found.setup or "")
        self.reset()
        self.files.load(found)
        for line in lines:
            self._say(line)

    def save_all(self, path: str, drive: str | None) -> None:
        """`AWGControl:SSAVe`: the setup with its waveforms."""
        self.files.change_drive(drive)
        self.save_setup(path, with_assets=None)

    def restore(self, path: str, drive: str | None) -> None:
        """`AWGControl:SREStore`."""
        self.files.change_drive(drive)
        self.open_setup(path)

    def _say(self, line: str) -> bytes:
        """What this instrument answers a client who sends it `line`; errors are queued."""
        execution = self.run(parse(line.encode("latin-1", "replace"), []))
        try:
            while True:
                next(execution)
        except StopIteration as end:
            return b"".join(map(bytes, end.value))

    def _answer(self, question: str) -> str:
        return self._say(question).decode("latin-1")

    # --- the basic waveform editor

    def compile_basic(self) -> None:
        """Put what the editor makes on the list, and on a channel, and play it, as it is told."""
        basic, name, number = self.basic, self.basic.name, 0
        while self.waveforms.find(name) is not None:
            number += 1
            name = f"{basic.name}_{number}"
        made = basic.compiled(self.world.generator("basic waveform", "noise"))
        markers = np.zeros(made.samples.size, np.uint8)
        self.waveforms.put(name, WaveformFile(made.samples, markers, made.sample_rate, made.amplitude_v, made.offset_v))
        if basic.assigns and basic.channel != "NONE":
            self.assign(int(basic.channel), name)
            if basic.plays:
                self.start()

    # --- status

    def _operation(self) -> int:
        return WAITING_FOR_TRIGGER if self.run_state() == WAITING else 0

    def _questionable(self) -> int:
        return FREQUENCY if self.timing.missing else 0

    # --- system

    def self_test(self) -> int:
        """`*TST?`: 0, passed, after minutes."""
        self.world.clock.advance(SELF_TEST_S)
        return super().self_test()

    def correct(self, path: str, name: str, quadrature_path: str | None) -> None:
        """`ACFile`: correction files are not simulated; -256 absent, otherwise -200."""
        _ = self.waveforms[name], self.files.disk.read(path)
        raise ScpiError(-200, "correction files are not simulated")

    def function_period(self, number: int) -> float:
        """Period of the function generator (s)."""
        return 1 / self.functions[number].frequency_hz

    def count_channels(self) -> int:
        """Two."""
        return len(self.sources)

    def scpi_version(self) -> str:
        """SCPI version the instrument follows."""
        return "1999.0"
