"""Setups and waveforms of the virtual oscilloscope on its disk and in its references.

Source: tm_devices 3.7, descriptions of the SAVe, RECAll, DELEte and FILESystem commands. A setup file holds the text of
`SET?`. A waveform file in the INTERNal format holds this twin's own form of it, which no other program reads;
SPREADSHEETCsv holds time and value of each point.
"""

import json
from collections.abc import Callable
from pathlib import PureWindowsPath

import numpy as np

from sim_backends.scpi.arguments import file_or, keyword, number_or_word, quoted
from sim_backends.scpi.commands import Action, Query, Setting
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.disk import Disk
from sim_backends.virtual.dpo72504dx.setups import PLACE, PLACES, Setups
from sim_backends.virtual.oscilloscope.mathematics import Reference, computed
from sim_backends.virtual.oscilloscope.plan import Plan
from sim_backends.virtual.oscilloscope.transfer import Trace
from sim_backends.virtual.oscilloscope.vertical import CHANNELS, Vertical
from sim_backends.world.signals import Acquisition

FOLDER = r"C:\Users\Public\Tektronix\TekScope"  # the manual's default folder, without its sub-folders

_REFERENCES = {f"REF{number}": number for number in (1, 2, 3, 4)}
_WAVEFORM = keyword(*CHANNELS, *(f"MATH{number}" for number in (1, 2, 3, 4)), *_REFERENCES)
_REFERENCE = keyword(*_REFERENCES)

STORAGE_COMMANDS = (
    Action("SAVe:SETUp", "storage.save_setup", file_or(PLACE)),
    Action("RECAll:SETUp", "storage.recall_setup", file_or(number_or_word(1, PLACES, "FACtory"))),
    Action("DELEte:SETUp", "storage.delete_setup", file_or(number_or_word(1, PLACES, "ALL"))),
    Action("SAVe:WAVEform", "storage.save_waveform", _WAVEFORM, file_or(_REFERENCE)),
    Setting("SAVe:WAVEform:FILEFormat", "storage.file_format", keyword("INTERNal", "SPREADSHEETCsv", "AUTO")),
    Action("RECAll:WAVEform", "storage.recall_waveform", quoted, _REFERENCE),
    Setting("FILESystem:CWD", "storage.disk.folder", quoted),
    Query("FILESystem:DIR?", "storage.folder_entries"),
    Action("FILESystem:MKDir", "storage.disk.make_folder", quoted),
    Action("FILESystem:DELEte", "storage.disk.delete", quoted),
    Action("FILESystem:READFile", "storage.read_file", quoted),
)


class Storage:
    """What is stored, and where.

    Args:
        setups: Those in memory.
        acquired: The waveform of a source; raises ScpiError.
        references: Reference waveforms by number.
        factory: Restores the factory setup.
    """

    def __init__(
        self,
        setups: Setups,
        acquired: Callable[[str], Trace],
        references: dict[int, Reference],
        factory: Callable[[], None],
    ) -> None:
        self._setups, self._acquired, self._references, self._factory = setups, acquired, references, factory
        self.disk = Disk(FOLDER)
        self.disk.folder = FOLDER
        self.file_format = "AUTO"

    def save_setup(self, where: int | PureWindowsPath) -> None:
        """To a location in memory or a file."""
        if isinstance(where, int):
            self._setups.save(where)
        else:
            self.disk.write(str(where), memoryview(self._setups.learn().encode("latin-1", "replace")))

    def recall_setup(self, where: int | str | PureWindowsPath) -> None:
        """From a location in memory, a file or the factory."""
        if isinstance(where, int):
            self._setups.recall(where)
        elif isinstance(where, PureWindowsPath):
            self._setups.obey(self.disk.read(str(where)).tobytes().decode("latin-1"))
        else:
            self._factory()

    def delete_setup(self, where: int | str | PureWindowsPath) -> None:
        """From a location in memory or all of them, or from the disk."""
        if isinstance(where, PureWindowsPath):
            self.disk.delete(str(where))
        else:
            self._setups.delete(*([where] if isinstance(where, int) else range(1, PLACES + 1)))

    def save_waveform(self, source: str, where: str | PureWindowsPath) -> None:
        """To a reference or a file; 2241 where nothing was acquired."""
        trace = self._acquired(source)
        if isinstance(where, PureWindowsPath):
            spreadsheet = self.file_format == "SPREADSHEETCsv" or where.suffix.lower() == ".csv"
            self.disk.write(str(where), memoryview(_spreadsheet(trace) if spreadsheet else _written(trace)))
        else:
            self._references[_REFERENCES[where]].trace = trace

    def recall_waveform(self, path: str, reference: str) -> None:
        """From a file to a reference; -200 where it holds no waveform."""
        self._references[_REFERENCES[reference]].trace = _read(self.disk.read(path).tobytes())

    def folder_entries(self) -> str:
        """`FILESystem:DIR?`: the names in the folder, quoted."""
        return ",".join(quoted.format(entry.name, verbose=False) for entry in self.disk.entries())

    def read_file(self, path: str) -> memoryview:
        """`FILESystem:READFile`, a command that replies: the bytes of a file, without a header."""
        return self.disk.read(path)


def _spreadsheet(trace: Trace) -> bytes:
    times = trace.start_s + trace.step_s * np.arange(trace.samples)
    return "".join(
        f"{time:.12e},{value:.8e}\n" for time, value in zip(times, trace.physical()[0], strict=True)
    ).encode()


def _written(trace: Trace) -> bytes:
    points = trace.codes if trace.values is None else trace.values
    plan = trace.plan
    head = {
        "type": points.dtype.str,
        "shape": points.shape,
        "computed": trace.values is not None,
        "unit": trace.unit,
        "channel": trace.channel,
        "vertical": trace.vertical,
        "acquisition": [plan.acquisition.sample_rate, plan.acquisition.start_s],
        "trigger_sample": plan.trigger_sample,
        "mode": plan.mode,
        "times_s": trace.times_s.tolist(),
        "offsets_s": trace.offsets_s.tolist(),
    }
    return json.dumps(head).encode() + b"\n" + points.tobytes()


def _read(data: bytes) -> Trace:
    head, _, points = data.partition(b"\n")
    try:
        told = json.loads(head)
        found = np.frombuffer(points, told["type"]).reshape(told["shape"])
        rate, start_s = told["acquisition"]
        acquisition = Acquisition((told["channel"],), rate, found.shape[1], start_s)
        plan = Plan(
            acquisition,
            acquisition,
            told["trigger_sample"],
            verticals=(),
            verticals_key=b"",
            mode=told["mode"],
            triggers=found.shape[0],
            aligned=False,
            condition=None,
            spacing_s=0.0,
            pointwise=False,
        )
        stamps = np.array(told["times_s"]), np.array(told["offsets_s"])
        trace = Trace(told["channel"], found, plan, Vertical(*told["vertical"]), *stamps, unit=told["unit"])
    except (ValueError, KeyError, TypeError, IndexError):
        raise ScpiError(-200, "the file holds no waveform") from None
    return computed(found, trace, trace.unit) if told["computed"] else trace
