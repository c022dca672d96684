"""Sequence files of the virtual AWG: `.seqx` and `.awgx`, zip archives of sequences (`.sml`) and waveforms (`.wfmx`).

An `.sml` file lists the steps of one sequence: its repeats, what it waits for, where it goes on, and an asset a track.
Source: instrument facts 1.4 and 1.7; the layout is that of the files the QCoDeS driver writes.
"""

import struct
import zipfile
import zlib
from dataclasses import dataclass
from io import BytesIO
from math import nan
from pathlib import PurePosixPath
from typing import Any
from xml.etree import ElementTree

from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.sequences import (
    MOST_REPEATS,
    MOST_STEPS,
    MOST_TRACKS,
    SequenceEntry,
    Step,
    new_step,
)
from sim_backends.virtual.awg70002a.wfmx import WaveformFile, parse_xml, read_wfmx, text_at, write_wfmx

LARGEST_UNPACKED = 2**28  # bytes
MOST_MEMBERS = 10_000
SETUP = "setup.scpi"
"""The member of an archive that a simulated instrument keeps its settings in."""

_NO_FILE_NAME = '/\\:*?"<>|'
_NO_DATE = (1980, 1, 1, 0, 0, 0)

_ZIP_ERRORS = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError),
    *(ValueError, LookupError, NotImplementedError, RuntimeError),
)
_INPUTS = {"None": "OFF", "TrigA": "ATRigger", "TrigB": "BTRigger", "Internal": "ITRigger"}
_FLAGS = {"NoChange": "NCHange", "High": "HIGH", "Low": "LOW", "Toggle": "TOGGle", "Pulse": "PULSe"}
_REPEATS = {"Once": "ONCE", "Infinite": "INFinite"}
_TARGETS = {"Next": "NEXT", "First": "FIRSt", "Last": "LAST", "End": "END"}
_TIMING = {"JumpImmed": "IMMediate", "JumpAtEnd": "END"}


@dataclass(frozen=True)
class SequenceFile:
    """What an archive holds: waveforms and sequences by name, in the order of the archive, and perhaps a setup."""

    waveforms: dict[str, WaveformFile]
    sequences: dict[str, SequenceEntry]
    setup: str | None = None

    def needed(self, name: str) -> tuple[dict[str, WaveformFile], dict[str, SequenceEntry]]:
        """A sequence, the sub-sequences and waveforms it uses; -224 if it is not in the archive."""
        if name not in self.sequences:
            raise ScpiError(-224, f"no sequence {name} in the file")
        wanted, waiting = {name: self.sequences[name]}, [self.sequences[name]]
        used: dict[str, WaveformFile] = {}
        while waiting:
            for step in waiting.pop().entries:
                for asset in filter(None, step.assets):
                    if step.subsequence and asset in self.sequences and asset not in wanted:
                        wanted[asset] = self.sequences[asset]
                        waiting.append(self.sequences[asset])
                    elif not step.subsequence and asset in self.waveforms:
                        used[asset] = self.waveforms[asset]
        return used, wanted


def read_seqx(data: memoryview) -> SequenceFile:
    """Read a `.seqx` or `.awgx` archive; -200 for anything else."""
    waveforms: dict[str, WaveformFile] = {}
    sequences: dict[str, SequenceEntry] = {}
    setup: str | None = None
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            members = archive.infolist()
            if len(members) > MOST_MEMBERS:
                raise ScpiError(-225, f"more than {MOST_MEMBERS} files in the archive")
            if sum(member.file_size for member in members) > LARGEST_UNPACKED:
                raise ScpiError(-225, f"more than {LARGEST_UNPACKED} bytes in the archive")
            for member in members:
                path = PurePosixPath(member.filename.replace("\\", "/"))
                if path.suffix.lower() not in (".wfmx", ".sml") and path.name != SETUP:
                    continue
                if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise ScpiError(-200, "an archive packed in an unusual way")
                with archive.open(member) as file:
                    content = file.read(member.file_size + 1)  # without a number: all it unpacks to, whatever it says
                if path.suffix.lower() == ".wfmx":
                    waveforms[path.stem] = read_wfmx(memoryview(content))
                elif path.name == SETUP:
                    setup = content.decode("latin-1")
                else:
                    sequence = read_sml(content, path.stem)
                    sequences[sequence.name] = sequence
    except _ZIP_ERRORS as error:
        raise ScpiError(-200, f"no archive that can be read: {str(error)[:200]}") from None
    if not all(name.isprintable() for name in (*waveforms, *sequences)):
        raise ScpiError(-200, "an archive with a name that does not fit on one line")
    return SequenceFile(waveforms, sequences, setup)


def write_archive(found: SequenceFile, *, time_stamp: str) -> bytes:
    """An archive that `read_seqx` reads; -257 for a name that cannot be a file's."""
    file = BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:

        def put(name: str, content: bytes) -> None:
            if any(character in _NO_FILE_NAME for character in name.partition("/")[2]):
                raise ScpiError(-257, name)
            archive.writestr(zipfile.ZipInfo(name, _NO_DATE), content)

        for name, waveform in found.waveforms.items():
            put(f"Waveforms/{name}.wfmx", write_wfmx(waveform, time_stamp=time_stamp))
        for name, sequence in found.sequences.items():
            put(f"Sequences/{name}.sml", write_sml(sequence, time_stamp=time_stamp))
        if found.setup is not None:
            put(f"Setup/{SETUP}", found.setup.encode("latin-1", "replace"))
    return file.getvalue()


def write_sml(sequence: SequenceEntry, *, time_stamp: str) -> bytes:
    """The `.sml` file of a sequence."""
    root = ElementTree.Element("DataFile", offset="0", version="0.1")
    sets = ElementTree.SubElement(ElementTree.SubElement(root, "DataSetsCollection"), "DataSets", version="1")
    said = ElementTree.SubElement(sets, "DataDescription")
    _say(said, "SequenceName", sequence.name)
    _say(said, "Timestamp", time_stamp)
    _say(said, "JumpTiming", _key(_TIMING, sequence.jump_timing))
    _say(said, "RecSampleRate", str(sequence.sample_rate))
    count, tracks = str(len(sequence.entries)), str(sequence.tracks)
    steps = ElementTree.SubElement(said, "Steps", StepCount=count, TrackCount=tracks)
    for number, step in enumerate(sequence.entries, 1):
        _write_step(ElementTree.SubElement(steps, "Step"), number, step)
    return bytes(ElementTree.tostring(root, "utf-8"))


def _write_step(element: ElementTree.Element, number: int, step: Step) -> None:
    _say(element, "StepNumber", str(number))
    counted = isinstance(step.repeats, int)
    _say(element, "Repeat", "RepeatCount" if counted else _key(_REPEATS, str(step.repeats)))
    _say(element, "RepeatCount", str(step.repeats) if counted else "1")
    _say(element, "WaitInput", _key(_INPUTS, step.wait))
    _say(element, "EventJumpInput", _key(_INPUTS, step.jump_input))
    for name, goal in (("EventJumpTo", step.jump_to), ("GoTo", step.goto)):
        indexed = isinstance(goal, int)
        _say(element, name, "StepIndex" if indexed else _key(_TARGETS, str(goal)))
        _say(element, f"{name}Step", str(goal) if indexed else "1")
    assets = ElementTree.SubElement(element, "Assets")
    for name in step.assets:
        asset = ElementTree.SubElement(assets, "Asset")
        _say(asset, "AssetName", name)
        _say(asset, "AssetType", "Sequence" if step.subsequence else "Waveform")
    flags = ElementTree.SubElement(element, "Flags")
    for track in step.track_flags:
        found = ElementTree.SubElement(flags, "FlagSet")
        for name, word in vars(track).items():
            ElementTree.SubElement(found, "Flag", name=name.upper()).text = _key(_FLAGS, word)


def _say(element: ElementTree.Element, name: str, text: str) -> None:
    ElementTree.SubElement(element, name).text = text


def _key(words: dict[str, str], meant: str) -> str:
    return next(key for key, word in words.items() if word == meant)


def read_sml(text: bytes, name: str) -> SequenceEntry:
    """The sequence of an `.sml` file, called `name` unless it says otherwise; -200 for anything else."""
    root = parse_xml(text)
    found = [step for step in root.iter() if step.tag.rpartition("}")[2] == "Step"]
    tracks = max((len(_named(step, "Asset")) for step in found), default=0)
    steps = root.find(".//{*}Steps")
    if steps is not None:
        tracks = max(tracks, _whole(steps.get("TrackCount", "1"), 1, MOST_TRACKS))
    if not 1 <= len(found) <= MOST_STEPS or tracks > MOST_TRACKS:
        raise ScpiError(-200, f"a sequence of {len(found)} steps and {tracks} tracks")
    entries = [_step(element, tracks) for element in found]
    sequence = SequenceEntry(text_at(root, "SequenceName") or name, tracks, entries)
    sequence.jump_timing = _TIMING.get(text_at(root, "JumpTiming"), "END")
    try:
        sequence.sample_rate = float(text_at(root, "RecSampleRate", "nan"))
    except ValueError:
        sequence.sample_rate = nan
    return sequence


def _named(element: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    return element.findall(f".//{{*}}{name}")


def _whole(text: str, lowest: int, highest: int) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 20) or not lowest <= int(text) <= highest:
        raise ScpiError(-200, f"{text[:20]} is not within {lowest}..{highest}")
    return int(text)


def _word(words: dict[str, str], element: ElementTree.Element, name: str) -> str:
    text = text_at(element, name, next(iter(words)))
    if text not in words:
        raise ScpiError(-200, f"{name} {text[:20]}")
    return words[text]


def _target(element: ElementTree.Element, name: str) -> int | str:
    if text_at(element, name) == "StepIndex":
        return _whole(text_at(element, name + "Step"), 1, MOST_STEPS)
    return _word(_TARGETS, element, name)


def _step(element: ElementTree.Element, tracks: int) -> Step:
    step = new_step(tracks)
    step.wait = _word(_INPUTS, element, "WaitInput")
    step.jump_input = _word(_INPUTS, element, "EventJumpInput")
    step.jump_to = _target(element, "EventJumpTo")
    step.goto = _target(element, "GoTo")
    if text_at(element, "Repeat") == "RepeatCount":
        step.repeats = _whole(text_at(element, "RepeatCount"), 1, MOST_REPEATS)
    else:
        step.repeats = _word(_REPEATS, element, "Repeat")
    names = [text_at(asset, "AssetName") for asset in _named(element, "Asset")]
    step.subsequence = "Sequence" in [text_at(asset, "AssetType") for asset in _named(element, "Asset")]
    step.assets = (names[:1] * tracks if step.subsequence else names + [""] * tracks)[:tracks]
    for flags, found in zip(step.track_flags, _named(element, "FlagSet"), strict=False):
        _read_flags(flags, found)
    return step


def _read_flags(flags: Any, element: ElementTree.Element) -> None:
    for flag in _named(element, "Flag"):
        name = (flag.get("name") or "").lower()
        if name in ("a", "b", "c", "d") and (flag.text or "") in _FLAGS:
            setattr(flags, name, _FLAGS[flag.text or ""])
