"""The mass-memory commands of the virtual AWG: files, and the waveforms and sequences loaded from them.

Source: instrument facts 1.4. Formats of older instruments (.wfm, .pat, .isf, .mat ...) are refused with -200.
"""

from pathlib import PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import block, integer, keyword, number_or_word, optional, quoted
from sim_backends.scpi.commands import Action, Query, Setting, definite_block
from sim_backends.scpi.messages import Chunk
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a import edits
from sim_backends.virtual.awg70002a.sequences import SequenceEntry, SequenceList
from sim_backends.virtual.awg70002a.seqx import SequenceFile, read_seqx, write_archive
from sim_backends.virtual.awg70002a.waveforms import Waveform, WaveformList, calendar
from sim_backends.virtual.awg70002a.wfmx import WaveformFile, read_text, read_wfmx, write_text, write_wfmx
from sim_backends.virtual.disk import CAPACITY, Disk
from sim_backends.world.world import VirtualClock

FOLDERS = (r"C:\Users\OEM\Documents", r"C:\inetpub\ftproot", r"C:\Program Files\Tektronix\AWG70000\Samples")  # recalled
NORMALISATION = keyword("NONE", "FSCale", "ZREFerence")
TEXT_BITS = {"TXT": None, "TXT8": 8, "TXT9": 9, "TXT10": 10}
_FORMAT = keyword(*TEXT_BITS, "TXT14", "ISF", "TDS", "WFM", "PAT", "TFW", "IQT", "TIQ", "WFMX")
_NUMBER = optional(integer(0, CAPACITY))
_DEPTH = number_or_word(8, 10, "ANALog")  # the word is recalled

FILE_COMMANDS = (
    Query("MMEMory:CATalog?", "files.catalogue", optional(quoted)),
    Action("MMEMory:CDIRectory", "files.change_folder", optional(quoted)),
    Setting("MMEMory:CDIRectory?", "files.disk.folder", quoted),
    Action("MMEMory:MSIS", "files.change_drive", optional(quoted)),
    Setting("MMEMory:MSIS?", "files.disk.drive", quoted),
    Action("MMEMory:MDIRectory", "files.disk.make_folder", quoted),
    Action("MMEMory:DELete", "files.delete", quoted, optional(quoted)),
    Action("MMEMory:DATA", "files.write", quoted, _NUMBER, block("u1")),
    Query("MMEMory:DATA?", "files.read", quoted, _NUMBER, _NUMBER),
    Query("MMEMory:DATA:SIZE?", "files.size", quoted),
    Action("MMEMory:IMPort", "files.import_waveform", quoted, quoted, _FORMAT),
    Setting("MMEMory:OPEN:PARameter:NORMalize", "files.normalisation", NORMALISATION),
    Action("MMEMory:OPEN", "files.open", quoted),
    Action("MMEMory:OPEN:SASSet[:WAVeform]", "files.open_waveforms", quoted, optional(quoted)),
    Action("MMEMory:OPEN:SASSet:SEQuence", "files.open_sequences", quoted, optional(quoted)),
    Action("MMEMory:OPEN:TXT", "files.open_text", quoted, _DEPTH),
    Setting("MMEMory:IMPort:PARameter:NORMalize", "files.normalisation", NORMALISATION),
    Action("MMEMory:SAVE:WAVeform:WFMX", "files.save_waveform", quoted, quoted),
    Action("MMEMory:SAVE:WAVeform:TXT", "files.save_text", quoted, quoted, _DEPTH, optional(keyword("I", "Q"))),
    Action("MMEMory:SAVE:SEQuence", "files.save_sequence", quoted, quoted),
)


def _file(waveform: Waveform) -> WaveformFile:
    recommended = (waveform.sample_rate, waveform.amplitude_v, waveform.offset_v)
    return WaveformFile(waveform.samples, waveform.markers, *recommended)


def _suffix(name: str) -> str:
    return PureWindowsPath(name).suffix.lower()


class MassMemory:
    """The disk, and what is loaded from it into the lists of the instrument."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self.disk = Disk(*FOLDERS)
        waveforms = WaveformList(clock)
        self.reset(waveforms, SequenceList(waveforms))

    def reset(self, waveforms: WaveformList, sequences: SequenceList) -> None:
        """`*RST`: other lists and no normalisation; the files stay."""
        self.waveforms, self.sequences = waveforms, sequences
        self.normalisation = "NONE"

    # --- files

    def catalogue(self, drive: str | None) -> str:
        """Bytes used and free, then `"name,type,size"` for everything in the current folder."""
        if drive is not None:
            self.disk.drive = drive
        lines = [
            quoted.format(f"{entry.name},{'DIR' if entry.size is None else ''},{entry.size or 0}", verbose=False)
            for entry in self.disk.entries()
        ]
        return ",".join([str(self.disk.used), str(CAPACITY - self.disk.used), *lines])

    def change_folder(self, name: str | None) -> None:
        """Another current folder, or the drive's uppermost one."""
        self.disk.folder = name or "\\"

    def change_drive(self, name: str | None) -> None:
        """Another drive: there is only one."""
        if name is not None:
            self.disk.drive = name

    def delete(self, name: str, drive: str | None) -> None:
        """Delete a file or an empty folder; -256 if there is none."""
        if drive is not None:
            self.disk.drive = drive
        self.disk.delete(name)

    def write(self, name: str, start: int | None, data: NDArray[np.uint8]) -> None:
        """Write a file, or from byte `start` on."""
        self.disk.write(name, data.data, start)

    def read(self, name: str, start: int | None, size: int | None) -> list[Chunk]:
        """A file as a block, from byte `start` on, `size` bytes; -222 beyond its end."""
        data, begin = self.disk.read(name), start or 0
        if begin > data.nbytes or (size is not None and begin + size > data.nbytes):
            raise ScpiError(-222, f"{name} has {data.nbytes} bytes")
        return definite_block(data[begin : data.nbytes if size is None else begin + size])

    def size(self, name: str) -> int:
        """Bytes of a file."""
        return self.disk.read(name).nbytes

    # --- loading

    def open(self, name: str) -> None:
        """Load a `.wfmx` file under its own name, or all of a `.seqx` file."""
        suffix = _suffix(name)
        if suffix == ".seqx":
            self.open_sequences(name, None)
            return
        data = self.disk.read(name)
        if suffix != ".wfmx":
            raise ScpiError(-200, f"files of the kind {suffix or 'without a name'} are not simulated")
        self.waveforms.put(PureWindowsPath(name).stem, read_wfmx(data))

    def import_waveform(self, name: str, path: str, form: str) -> None:
        """Load a text file (or `.wfmx`) as the waveform `name`; -200 for the other formats."""
        if form in TEXT_BITS:
            self._put_text(name, path, TEXT_BITS[form])
        elif form == "WFMX":
            self.waveforms.put(name, read_wfmx(self.disk.read(path)))
        else:
            self.disk.read(path)  # absent: -256
            raise ScpiError(-200, f"files of the format {form} are not simulated")

    def open_waveforms(self, path: str, name: str | None) -> None:
        """Load all waveforms of an archive, or one; -224 if it is not there."""
        found = self._archive(path).waveforms
        if name is not None and name not in found:
            raise ScpiError(-224, f"no waveform {name} in {path}")
        for key in found if name is None else (name,):
            self.waveforms.put(key, found[key])

    def open_sequences(self, path: str, name: str | None) -> None:
        """Load all sequences of an archive with all its waveforms, or one with what it uses."""
        archive = self._archive(path)
        waveforms, sequences = (archive.waveforms, archive.sequences) if name is None else archive.needed(name)
        self.load(SequenceFile(waveforms, sequences))

    def save_waveform(self, name: str, path: str) -> None:
        """Write a waveform to a `.wfmx` file."""
        self.disk.write(path, memoryview(write_wfmx(_file(self.waveforms[name]), time_stamp=self._stamp())))

    def open_text(self, path: str, depth: int | str) -> None:
        """Load a text file under its own name."""
        self._put_text(PureWindowsPath(path).stem, path, depth if isinstance(depth, int) else None)

    def save_text(self, name: str, path: str, depth: int | str, component: str | None) -> None:
        """Write a component of a waveform as text, as real numbers or as DAC codes."""
        waveform = self.waveforms[name]
        file = WaveformFile(waveform.component(component or "I"), waveform.markers)
        self.disk.write(path, memoryview(write_text(file, depth if isinstance(depth, int) else None)))

    def save_sequence(self, name: str, path: str) -> None:
        """Write a sequence to a `.seqx` archive, with what it uses."""
        everything = SequenceFile(*self._assets())
        waveforms, sequences = everything.needed(self.sequences[name].name)
        self._write_archive(path, SequenceFile(waveforms, sequences))

    def save_setup(self, path: str, settings: str, *, with_assets: bool) -> None:
        """Write settings to an archive, with all waveforms and sequences."""
        assets = self._assets() if with_assets else ({}, {})
        self._write_archive(path, SequenceFile(*assets, settings))

    def setup(self, path: str) -> SequenceFile:
        """An archive with a setup in it; -200 for one without."""
        found = self._archive(path)
        if found.setup is None:
            raise ScpiError(-200, f"{path} holds no setup of a simulated instrument")
        return found

    def load(self, archive: SequenceFile) -> None:
        """Put what an archive holds into the lists."""
        for name, waveform in archive.waveforms.items():
            self.waveforms.put(name, waveform)
        for sequence in archive.sequences.values():
            self.sequences.put(sequence)

    def _assets(self) -> tuple[dict[str, WaveformFile], dict[str, SequenceEntry]]:
        waveforms = {name: _file(self.waveforms[name]) for name in self.waveforms}
        return waveforms, {name: self.sequences[name] for name in self.sequences}

    def _write_archive(self, path: str, found: SequenceFile) -> None:
        self.disk.write(path, memoryview(write_archive(found, time_stamp=self._stamp())))

    def _stamp(self) -> str:
        return f"{calendar(self._clock.now):%Y-%m-%dT%H:%M:%S.000+00:00}"

    def _archive(self, path: str) -> SequenceFile:
        data = self.disk.read(path)
        if _suffix(path) not in (".seqx", ".awgx"):
            raise ScpiError(-200, f"files of the kind {_suffix(path) or 'without a name'} are not simulated")
        return read_seqx(data)

    def _put_text(self, name: str, path: str, bits: int | None) -> None:
        file = read_text(self.disk.read(path), bits)
        if self.normalisation != "NONE":
            samples = edits.normalised(file.samples, keep_zero=self.normalisation == "ZREFerence")
            file = WaveformFile(samples, file.markers)
        self.waveforms.put(name, file)
