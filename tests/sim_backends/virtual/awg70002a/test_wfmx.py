"""Waveform files: what is written is read, and nothing else is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.wfmx import WaveformFile, read_text, read_wfmx, write_wfmx

STAMP = "2024-01-01T00:00:00.000+00:00"


def foreign(samples: np.ndarray, markers: np.ndarray | None = None) -> bytes:
    """A file as other programs write it: an offset of nine digits, CR LF, float32, marker bits 0 and 1."""
    header = (
        '<DataFile offset="000000000" version="0.1">\r\n<DataSetsCollection xmlns="http://www.tektronix.com">\r\n'
        '<DataSets version="1" xmlns="http://www.tektronix.com">\r\n<DataDescription>\r\n'
        f"<NumberSamples>{samples.size}</NumberSamples>\r\n<SamplesType>AWGWaveformSample</SamplesType>\r\n"
        f"<MarkersIncluded>{str(markers is not None).lower()}</MarkersIncluded>\r\n"
        "<NumberFormat>Single</NumberFormat>\r\n<Endian>Little</Endian>\r\n</DataDescription>\r\n"
        '<ProductSpecific name="">\r\n<ReccSamplingRate units="Hz">NaN</ReccSamplingRate>\r\n</ProductSpecific>\r\n'
        "</DataSets>\r\n</DataSetsCollection>\r\n<Setup />\r\n</DataFile>"
    )
    header = header.replace("000000000", f"{len(header):09d}")
    return header.encode() + samples.astype("<f4").tobytes() + (b"" if markers is None else markers.tobytes())


def test_a_foreign_file() -> None:
    samples = np.linspace(-1, 1, 2400, dtype=np.float32)
    file = read_wfmx(memoryview(foreign(samples)))
    assert np.array_equal(file.samples, samples)
    assert not file.markers.any()
    assert np.isnan(file.sample_rate)
    markers = np.arange(2400, dtype=np.uint8) % 4
    file = read_wfmx(memoryview(foreign(samples, markers)))
    assert np.array_equal(file.markers, markers << 6)


@given(
    samples=arrays(np.float32, st.integers(1, 50), elements=st.floats(-1, 1, width=32)),
    rate=st.floats(1.49e3, 25e9) | st.just(float("nan")),
    seed=st.integers(0, 2**32 - 1),
)
def test_round_trip(samples: np.ndarray, rate: float, seed: int) -> None:
    markers = (np.random.default_rng(seed).integers(0, 4, samples.size) << 6).astype(np.uint8)
    data = write_wfmx(WaveformFile(samples, markers, rate, 0.3, 0.1), time_stamp=STAMP)
    file = read_wfmx(memoryview(data))
    assert np.array_equal(file.samples, samples)
    assert np.array_equal(file.markers, markers)
    assert np.array_equal(file.sample_rate, rate, equal_nan=True)
    assert (file.amplitude_v, file.offset_v) == (0.3, 0.1)


@given(cut=st.integers(0, 900), junk=st.binary(max_size=40))
def test_what_is_no_such_file(cut: int, junk: bytes) -> None:
    data = foreign(np.zeros(60, np.float32))
    with pytest.raises(ScpiError):
        read_wfmx(memoryview(data[: min(cut, len(data) - 1)]))
    with pytest.raises(ScpiError):
        read_wfmx(memoryview(junk))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"Little", b"Bigger"),
        (b"Single", b"Double"),
        (b">60<", b">-9<"),
        (b"<Setup />", b"<Set up//"),
        (b"<DataFile ", b"<!DOCTYPE "),
        (b">NaN<", b">\xff\xff\xff<"),
    ],
)
def test_wrong_headers(old: bytes, new: bytes) -> None:
    data = foreign(np.zeros(60, np.float32)).replace(old, new)
    with pytest.raises(ScpiError):
        read_wfmx(memoryview(data))


def test_a_recommended_rate_that_is_no_number_is_none() -> None:
    data = foreign(np.zeros(60, np.float32)).replace(b">NaN<", b">abc<")
    assert np.isnan(read_wfmx(memoryview(data)).sample_rate)


def test_text_files() -> None:
    file = read_text(memoryview(b"-1\r\n0.5,1\n1\t0\t1\n\n"))
    assert file.samples.tolist() == [-1.0, 0.5, 1.0]
    assert file.markers.tolist() == [0, 0x40, 0x80]
    assert read_text(memoryview(b"0\n255"), 8).samples.tolist() == [-1.0, 1.0]
    for text, bits in ((b"", None), (b"a\n", None), (b"1,2,3,4", None), (b"256", 8), (b"\xff", None)):
        with pytest.raises(ScpiError):
            read_text(memoryview(text), bits)
