"""Waveform files of the virtual AWG: the `.wfmx` format and the text formats.

`.wfmx`: an XML header whose root says in `offset` how long it is, little-endian float32 samples, then one marker byte a
sample if the header says so: marker 1 is bit 0, marker 2 is bit 1.  Source: instrument facts 1.4.
"""

import re
from dataclasses import dataclass
from math import nan
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.status import ScpiError

FILE_MARKER_SHIFT = 6  # bits 0 and 1 in a file are bits 6 and 7 on the wire
_OFFSET = re.compile(rb'offset\s*=\s*"(\d{1,12})"')
_HEADER_START = 512  # bytes in which the offset must be found
LARGEST_XML = 2**24  # bytes; in memory it is thirty times that
LARGEST_TEXT = 2**25  # bytes of a waveform as text; in memory fifty times that
_SINGLE = (-float(np.finfo(np.float32).max), float(np.finfo(np.float32).max))
_COUNT = re.compile(r"[0-9]{1,12}")


@dataclass(frozen=True, eq=False)
class WaveformFile:
    """What a waveform file holds.

    Attributes:
        samples: (n,) float32, -1..1.
        markers: (n,) marker bytes as on the wire (marker 1 is bit 6).
        sample_rate: recommended rate (S/s); nan for none, as the two below.
        amplitude_v: recommended amplitude (Vpp).
        offset_v: recommended offset (V).
    """

    samples: NDArray[np.float32]
    markers: NDArray[np.uint8]
    sample_rate: float = nan
    amplitude_v: float = nan
    offset_v: float = nan


def parse_xml(data: bytes | memoryview) -> ElementTree.Element:
    """The root of an XML text in UTF-8; -200 if it is none, is too large, or declares a document type."""
    if len(data) > LARGEST_XML:
        raise ScpiError(-200, f"an XML text of more than {LARGEST_XML} bytes")
    try:
        text = bytes(data).decode("utf-8-sig")
        if "<!DOCTYPE" in text:
            raise ScpiError(-200, "an XML text that declares a document type")
        return ElementTree.fromstring(text)  # noqa: S314 - without a document type there are no entities to expand
    except (ElementTree.ParseError, ValueError) as error:
        raise ScpiError(-200, f"not XML: {error}") from None


def text_at(element: ElementTree.Element, name: str, default: str = "") -> str:
    """Text of the first descendant `name`, whatever its namespace."""
    found = element.find(f".//{{*}}{name}")
    return default if found is None or found.text is None else found.text.strip()


def _number(element: ElementTree.Element, name: str) -> float:
    try:
        return float(text_at(element, name, "nan"))
    except ValueError:
        return nan


def read_wfmx(data: memoryview) -> WaveformFile:
    """Read a `.wfmx` file; -200 for anything else, or a file that is cut short."""
    match = _OFFSET.search(bytes(data[:_HEADER_START]))
    if match is None:
        raise ScpiError(-200, "no offset in the header of a .wfmx file")
    begin = int(match[1])
    if begin > data.nbytes:
        raise ScpiError(-200, f"a .wfmx file of {data.nbytes} bytes, a header of {begin} announced")
    header = parse_xml(data[:begin])
    points = text_at(header, "NumberSamples")
    form = (text_at(header, "NumberFormat", "Single"), text_at(header, "Endian", "Little"))
    if _COUNT.fullmatch(points) is None or int(points) < 1 or form != ("Single", "Little"):
        raise ScpiError(-200, f"a .wfmx file of {points[:20] or 'no'} samples, {form[0][:20]}, {form[1][:20]}")
    count, marked = int(points), text_at(header, "MarkersIncluded").lower() == "true"
    end = begin + 4 * count
    if end + marked * count > data.nbytes:
        raise ScpiError(-200, f"a .wfmx file of {data.nbytes} bytes, {end + marked * count} announced")
    samples = np.frombuffer(data[begin:end], "<f4").astype(np.float32)
    markers = np.zeros(count, np.uint8)
    if marked:
        markers[:] = (np.frombuffer(data[end : end + count], np.uint8) & 3) << FILE_MARKER_SHIFT
    names = ("ReccSamplingRate", "ReccAmplitude", "ReccOffset")
    return WaveformFile(samples, markers, *(_number(header, name) for name in names))


def write_wfmx(waveform: WaveformFile, *, time_stamp: str) -> bytes:
    """A `.wfmx` file of `waveform`, with markers."""
    header = (
        '<DataFile offset="{offset:09d}" version="0.1">\r\n'
        '<DataSetsCollection xmlns="http://www.tektronix.com">\r\n'
        '<DataSets version="1" xmlns="http://www.tektronix.com">\r\n'
        "<DataDescription>\r\n"
        f"<NumberSamples>{waveform.samples.size}</NumberSamples>\r\n"
        "<SamplesType>AWGWaveformSample</SamplesType>\r\n"
        "<MarkersIncluded>true</MarkersIncluded>\r\n"
        "<NumberFormat>Single</NumberFormat>\r\n"
        "<Endian>Little</Endian>\r\n"
        f"<Timestamp>{time_stamp}</Timestamp>\r\n"
        "</DataDescription>\r\n"
        '<ProductSpecific name="">\r\n'
        f'<ReccSamplingRate units="Hz">{_written(waveform.sample_rate)}</ReccSamplingRate>\r\n'
        f'<ReccAmplitude units="Volts">{_written(waveform.amplitude_v)}</ReccAmplitude>\r\n'
        f'<ReccOffset units="Volts">{_written(waveform.offset_v)}</ReccOffset>\r\n'
        "</ProductSpecific>\r\n"
        "</DataSets>\r\n"
        "</DataSetsCollection>\r\n"
        "<Setup />\r\n"
        "</DataFile>"
    )
    text = header.format(offset=len(header.format(offset=0)))
    markers = (waveform.markers >> FILE_MARKER_SHIFT).astype(np.uint8)
    return text.encode("ascii") + waveform.samples.astype("<f4").tobytes() + markers.tobytes()


def _written(value: float) -> str:
    return "NaN" if np.isnan(value) else repr(float(value))


def write_text(waveform: WaveformFile, bits: int | None) -> bytes:
    """A text file that `read_text` reads: sample, marker 1 and marker 2 a line."""
    markers = waveform.markers >> FILE_MARKER_SHIFT
    unit = np.clip(np.nan_to_num(waveform.samples), -1, 1).astype(np.float64)
    samples = unit if bits is None else np.rint((unit + 1) / 2 * (2**bits - 1)).astype(np.int64)
    rows = zip(samples.tolist(), (markers & 1).tolist(), (markers >> 1 & 1).tolist(), strict=True)
    return "".join(f"{sample!r},{one},{two}\r\n" for sample, one, two in rows).encode("ascii")


def read_text(data: memoryview, bits: int | None = None) -> WaveformFile:
    """Read a text file: one sample a line, then marker 1 and 2 if the line has them; commas or white space between.

    Without `bits` samples are real numbers, -1..1; with `bits` they are DAC codes, 0..2^bits - 1. -200 otherwise.
    """
    if data.nbytes > LARGEST_TEXT:
        raise ScpiError(-200, f"a text file of more than {LARGEST_TEXT} bytes")
    try:
        lines = [line for line in re.split(r"[\r\n]+", bytes(data).decode("ascii").strip()) if line.strip()]
        rows = [[float(field) for field in re.split(r"[\s,;]+", line.strip())] for line in lines]
    except ValueError:
        raise ScpiError(-200, "a text file with something else than numbers") from None
    if not rows or any(len(row) not in (1, 2, 3) for row in rows):
        raise ScpiError(-200, "a text file with lines that are no sample")
    samples = np.array([row[0] for row in rows])
    if bits is not None:
        if not np.all((samples >= 0) & (samples < 2**bits)):
            raise ScpiError(-200, f"codes outside {bits} bits")
        samples = 2 * samples / (2**bits - 1) - 1
    markers = [(len(row) > 1 and row[1] != 0) + 2 * (len(row) > 2 and row[2] != 0) for row in rows]
    samples = np.clip(samples, *_SINGLE)
    return WaveformFile(samples.astype(np.float32), np.array(markers, np.uint8) << np.uint8(FILE_MARKER_SHIFT))
