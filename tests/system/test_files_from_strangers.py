"""Hostile files of every kind: each is refused in one line, in little memory and time, and nothing is written."""

import io
import json
import os
import pickle
import stat
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from labctl.bench.recording.format import CHECK, RECORD, Kind
from labctl.bench.simulation import SIMULATED_LASER
from sim_backends.virtual.awg70002a.wfmx import WaveformFile, write_wfmx
from tests.checkout import ROOT
from tests.fuzz.readers import PICTURE
from tests.system.hostile_runs import RUNS, Made
from tests.system.limited_reader import SECONDS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs setrlimit and /proc")

HOSTILE: dict[str, dict[str, tuple[Made, str]]] = {}
"""Kind of file -> hostile file -> what is in it, and what the refusal says."""

MILLION = 1 << 20
BOMB = 2048
"""Millions of bytes that a bomb unpacks to, all zero."""


def deflated(millions: int) -> bytes:
    """So many times 2^20 zeros as a raw deflate stream."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = packer.compress(bytes(MILLION)) + packer.flush(zlib.Z_FULL_FLUSH)
    return block * millions + b"\x03\x00"


def zipped(*members: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return file.getvalue()


def zip_bomb(name: str, declared: int) -> bytes:
    """A zip file whose one member unpacks to `BOMB` million bytes and declares `declared`."""
    stream = deflated(BOMB)
    sizes = struct.pack("<III", 0, len(stream), declared)
    fields = struct.pack("<HHHHH", 20, 0, zipfile.ZIP_DEFLATED, 0, 33)
    local = b"PK\x03\x04" + fields + sizes + struct.pack("<HH", len(name), 0) + name.encode()
    entry = (
        b"PK\x01\x02" + struct.pack("<H", 20) + fields + sizes + struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, 0)
    )
    entry += name.encode()
    end = b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(entry), len(local) + len(stream), 0)
    return local + stream + entry + end


# --- TOML

DEEP = b"a = " + b"[\n" * 30_000
TOML: dict[str, tuple[Made, str]] = {
    "a megabyte in one line": (b'a = "' + b"x" * MILLION + b'"', "larger than 65536 bytes"),
    "a long line": (b'a = "' + b"x" * 50_000 + b'"', "a line of more than 2000 bytes"),
    "a file without end": (lambda path: path.symlink_to("/dev/zero"), ""),
    "lists in lists": (DEEP, "too deep"),
    "keys of a thousand parts": ((b"a." * 990 + b"a = 1\n") * 30, ""),
    "a number of ten thousand digits": (b"a = 1\nb = " + b"\n".join([b"[", *[b"9" * 1900] * 5, b"]"]), ""),
    "a number of a thousand hexadecimal digits": (b"a = 0x" + b"f" * 1500, "more than 64 bits"),
    "a key of two lines": (b'"a\\nb" = 1', "does not fit on one line"),
    "a key that paints the screen": (b'[sim.parameters]\n"\\u001b[2J" = 1', "does not fit on one line"),
    "other bytes": (b"a = '\xff'", "can't decode byte 0xff"),
}
HOSTILE["station"] = TOML | {
    "a command behind the address": (
        b'[awg]\naddress = "TCPIP0::192.0.2.1::SOCKET\\n*RST"',
        "does not fit on one line",
    ),
    "a semicolon in the address": (b'[awg]\naddress = "TCPIP0::192.0.2.1::SOCKET;*RST"', "awg.address"),
    "a quote in the address": (b"[scope]\naddress = 'TCPIP0::\"::SOCKET'", "scope.address"),
    "a name of several lines": (b'name = """a\nlabctl: all is well"""', "does not fit on one line"),
    "a million million ports": (b"[patch_panel]\nports = '0-999999999999'", "is not a list of ports"),
    "a limit that is no number": (b"[limits]\noptical_power = nan", "limits.optical_power"),
    "a power that is no number": (b"[laser]\npower = nan", "laser.power"),
    "a power beyond numbers": (b"[laser]\npower = '1e999 W'", "laser.power"),
    "an endless timeout": (b"[awg]\ntimeout = inf", "awg.timeout"),
    "a value of a thousand letters": (b"[laser]\npower = '" + b"x" * 1500 + b"'", "laser.power"),
}
HOSTILE["protocol"] = TOML | {
    "a command behind a name": (
        b'protocol = "image-readout"\n[settings]\ndataset = "mnist\\nOUTPUT ON"',
        "dataset = 'mnist\\nOUTPUT ON' does not fit on one line",
    ),
    "a module in place of a name": (b'protocol = "os:system"', "'os:system' is not installed"),
    "a name of two lines": (b'protocol = "a\\nb"', "is not installed"),
}
HOSTILE["experiment"] = TOML | {
    "a command behind a name": (
        b'title = "t"\npaper = "p"\nstatement = "s"\nanalysis = "recognition"\n[runs.a]\nprotocol = "image-readout"\n'
        b'settings = { dataset = "mnist\\nOUTPUT ON" }',
        "does not fit on one line",
    ),
}


def laser(old: str, new: str) -> bytes:
    """The table of the simulated laser with one text replaced."""
    text = SIMULATED_LASER.read_text("utf-8")
    assert old in text
    return text.replace(old, new).encode()


HOSTILE["laser table"] = TOML | {
    "two commands in two lines": (laser("{value:.4f}", "{value:.4f}\\nOUTPUT ON"), "set_wavelength.write"),
    "two commands in one line": (laser("{value:.4f}", "{value:.4f};OUTPUT ON"), "set_wavelength.write"),
    "a number of a billion letters": (laser(":.4f", ":.999999999f"), "set_wavelength.write"),
    "a number filled with zeros": (laser(":.4f", ":01000000000.4f"), "set_wavelength.write"),
    "what Python keeps behind a number": (laser("{value:.4f}", "{value.__class__}"), "set_wavelength.write"),
    "an expression that takes for ever": (laser("(?P<text>.+)", "(?P<text>(.+)+)$"), "could take for ever"),
    "an expression with many choices": (laser("(?P<text>.+)", "(?P<text>.+)" + "a?" * 40), "could take for ever"),
    "an expression that is none": (laser("(?P<text>.+)", "(?P<text>"), "is not a regular expression"),
    "a power in another unit": (laser('unit = "dBm"', 'unit = "mW"'), "the number is sent and read in dBm"),
    "an expression without its value": (laser('"(?P<value>[01])"', '"[01]"'), "reply lacks (?P<value>...)"),
    "an ending that is a command": (laser('write_eol = "\\n"', 'write_eol = "\\nOUTPUT ON\\n"'), "write_eol"),
    "an endless wait": (laser("poll_s = 0.0", "poll_s = inf"), "poll_s"),
}

# --- recordings

HEADING = b'{"format": "labctl-recording", "format_version": "1.0"}\n'
PARTNER = b'{"instrument": "awg", "resource": "here"}'


def record(kind: Kind, stored: bytes, *, length: int | None = None, packed: bool = False, announced: int = 0) -> bytes:
    size = len(stored) if length is None else length
    fields = RECORD.pack(kind, packed, 1, 0, size, announced or len(stored))
    return fields + CHECK.pack(zlib.crc32(stored, zlib.crc32(fields))) + stored


def zlib_bomb() -> bytes:
    return b"\x78\x9c" + deflated(BOMB) + bytes(4)


HOSTILE["recording"] = {
    "a length without end": (HEADING + record(Kind.SENT, b"x", length=2**63, packed=True), "is damaged at byte"),
    "a length of another kind": (HEADING + record(Kind.SENT, b"x", length=2**63), "is damaged at byte"),
    "a message of two gigabytes": (
        HEADING + record(Kind.OPENED, PARTNER) + record(Kind.SENT, zlib_bomb(), length=BOMB * MILLION, packed=True),
        "is damaged at byte",
    ),
    "a message that unpacks to more than it says": (
        HEADING + record(Kind.OPENED, PARTNER) + record(Kind.SENT, zlib_bomb(), length=len(zlib_bomb()), packed=True),
        "has changed while it was read",
    ),
    "a heading of a megabyte": (b"[" * MILLION + b"\n", "is not a recording"),
    "a heading in a heading": (b"[" * 100_000 + b"\n", "is not a recording"),
    "a heading without a line's end": (lambda path: path.symlink_to("/dev/zero"), "is not a recording"),
    "a version that is none": (b'{"format": "labctl-recording", "format_version": [1]}\n', "format version"),
    "a connection to nothing": (HEADING + record(Kind.OPENED, b"[]"), "does not say to what"),
    "a connection to a number": (HEADING + record(Kind.OPENED, b'{"instrument": 1}'), "does not say to what"),
    "a connection in a connection": (HEADING + record(Kind.OPENED, b"[" * 100_000), "does not say to what"),
}


HOSTILE |= RUNS


# --- data sets


def idx(*sizes: int) -> bytes:
    return bytes([0, 0, 8, len(sizes)]) + struct.pack(f">{len(sizes)}I", *sizes)


def npy(shape: str, kind: str = "|u1", data: bytes = b"") -> bytes:
    header = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def pickled() -> bytes:
    file = io.BytesIO()
    np.save(file, np.array([Path], object), allow_pickle=True)
    return file.getvalue()


class Planted:
    """What unpickles to a file written outside."""

    def __reduce__(self) -> tuple[Callable[[str], object], tuple[str]]:
        return os.mkdir, ("planted",)


HUGE_ARRAYS: dict[str, tuple[Made, str]] = {
    "an array without end": (npy("(1099511627776,)"), "declares"),
    "numbers beyond numbers": (npy(f"({'9' * 3000},)"), ""),
    "nothing times everything": (npy("(0, 9223372036854775807)"), ""),
    "less than nothing": (npy("(-1, -1)", data=b"x"), ""),
    "brackets in brackets": (npy("(" * 5000), ""),
    "pickled objects": (pickled(), ""),
    "a pickle": (pickle.dumps(Planted()), ""),
    "a shape that is a program": (npy("__import__('os').mkdir('planted')"), ""),
}
LABELS = npy("(1,)", "<i8", bytes(8))
HOSTILE["series"] = HUGE_ARRAYS
ARRAYS_IN_ARCHIVES: dict[str, tuple[Made, str]] = {
    what: (zipped(("images.npy", content), ("labels.npy", LABELS)), text)
    for what, (content, text) in HUGE_ARRAYS.items()
    if isinstance(content, bytes)
}
HOSTILE["npz"] = ARRAYS_IN_ARCHIVES | {
    "two gigabytes of zeros": (zip_bomb("images.npy", BOMB * MILLION), "unpacks to more than 268435456 bytes"),
    "two gigabytes that declare a kilobyte": (zip_bomb("images.npy", 1000), "images"),
    "packed in an unusual way": (
        zipped(("images.npy", npy("(1, 1, 1)", data=b"x")), ("labels.npy", LABELS), method=zipfile.ZIP_LZMA),
        "is not a numpy file",
    ),
    "places outside": (zipped(("../images.npy", npy("(1, 1, 1)", data=b"x"))), "is not an .npz file"),
}
HOSTILE["idx"] = {
    "counts without end": (idx(2**32 - 1, 2**32 - 1, 2**32 - 1), "bytes of data where the header"),
    "nothing times everything": (idx(0, 2**32 - 1, 2**32 - 1, 2**32 - 1), "bytes of data where the header"),
    "255 axes": (bytes([0, 0, 8, 255]) + struct.pack(">255I", *[1] * 255) + b"x", "255 axes, at most 4"),
}
HOSTILE["packed idx"] = {
    "two gigabytes of zeros": (b"\x1f\x8b\x08\0\0\0\0\0\0\xff" + deflated(BOMB) + bytes(8), "holds more than"),
}
HOSTILE["vowels"] = {
    "blanks without end": (b"0 " + b" " * MILLION, "not a vowel"),
    "a line without end": (b"0 1 1 " + b"1 " * MILLION, "not a vowel"),
    "numbers without end": (b"0 1 1 " + b"1" * MILLION, "not a vowel"),
    "rows without end": (b"0 1 1 1 1 1 1 1 1 1 1 1 1 1\n" * 20_000, "more than 10000 rows"),
}


def jpeg(rows: int = PICTURE[0], columns: int = PICTURE[1], kind: str = "JPEG") -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.zeros(PICTURE, np.uint8)).save(file, kind)
    content = bytearray(file.getvalue())
    if kind == "JPEG":
        start = content.index(b"\xff\xc0")
        content[start + 5 : start + 9] = struct.pack(">HH", rows, columns)
    return bytes(content)


def png_bomb() -> bytes:
    """A PNG that declares 50000 x 50000 pixels."""
    whole = jpeg(kind="PNG")
    return whole[:16] + struct.pack(">II", 50_000, 50_000) + whole[24:]


def symlink_entry() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("Positive/1.jpg", jpeg())
        entry = zipfile.ZipInfo("Negative/1.jpg")
        entry.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(entry, "../../../../etc/passwd")
    return file.getvalue()


WHOLE = (("Negative/1.jpg", jpeg()), ("Positive/1.jpg", jpeg()))
HOSTILE["pictures"] = {
    "two gigabytes of zeros": (zip_bomb("Negative/1.jpg", BOMB * MILLION), "no such picture"),
    "two gigabytes that declare a kilobyte": (zip_bomb("Negative/1.jpg", 1000), "no such picture"),
    "places outside": (zipped(*WHOLE, ("../../planted.jpg", jpeg())), "a place outside the archive"),
    "a place of the system": (zipped(*WHOLE, ("/etc/planted.jpg", jpeg())), "a place outside the archive"),
    "a link to a file of the system": (symlink_entry(), "is not a whole JPEG file"),
    "a picture of four thousand million pixels": (
        zipped(WHOLE[0], ("Positive/1.jpg", jpeg(65500, 65500))),
        "is 65500x65500 pixels",
    ),
    "another format with another decoder": (
        zipped(WHOLE[0], ("Positive/1.jpg", jpeg(kind="PNG"))),
        "is not a whole JPEG file",
    ),
    "a decompression bomb": (zipped(WHOLE[0], ("Positive/1.jpg", png_bomb())), "is not a whole JPEG file"),
}

# --- waveforms

XML = b'<DataFile offset="%09d"><NumberSamples>%b</NumberSamples></DataFile>'


def wfmx(samples: bytes = b"1", begin: int | None = None) -> bytes:
    size = len(XML % (0, samples))
    return XML % (size if begin is None else begin, samples) + bytes(4)


def sml(name: str) -> bytes:
    return f"<Sequence><SequenceName>{name}</SequenceName><Step/></Sequence>".encode()


ENTITIES = b'<!DOCTYPE x [<!ENTITY a "' + b"x" * 1000 + b'"><!ENTITY b "' + b"&a;" * 1000 + b'">]>'
HOSTILE["wfmx"] = {
    "a header longer than the file": (wfmx(begin=999_999_999), "a header of 999999999 announced"),
    "a header that ends inside": (wfmx(begin=20), "not XML"),
    "a header of twenty megabytes": (
        b'<DataFile offset="020000000">' + b" " * 20_000_000,
        "an XML text of more than 16777216 bytes",
    ),
    "samples without end": (wfmx(b"999999999999"), "announced"),
    "a number of other digits": (wfmx("²".encode()), "samples"),
    "a number of five thousand digits": (wfmx(b"1" * 5000), "samples"),
    "entities in entities": (ENTITIES + b'<DataFile offset="000004089">&b;</DataFile>', ""),
    "elements in elements": (b'<DataFile offset="000999929">' + b"<a>" * 333_300 + bytes(4), "not XML"),
}
HOSTILE["waveform text"] = {
    "forty megabytes": (b"0\n" * 20_000_000, "a text file of more than 33554432 bytes"),
    "digits without end": (b"9" * MILLION + b"\nx", "something else than numbers"),
    "other bytes": (b"\xff" * MILLION, "something else than numbers"),
}
HOSTILE["seqx"] = {
    "two gigabytes of zeros": (zip_bomb("w.wfmx", BOMB * MILLION), "more than 268435456 bytes"),
    "two gigabytes that declare a kilobyte": (zip_bomb("w.wfmx", 1000), "-200"),
    "twenty thousand files": (zipped(*((f"{number}", b"") for number in range(20_000))), "more than 10000 files"),
    "packed in an unusual way": (zipped(("a.sml", sml("a")), method=zipfile.ZIP_LZMA), "packed in an unusual way"),
    "a name of two lines": (zipped(("a.sml", sml("a\nb"))), "does not fit on one line"),
    "a waveform of two lines": (
        zipped(("a\nb.wfmx", write_wfmx(WaveformFile(np.zeros(4, np.float32), np.zeros(4, np.uint8)), time_stamp=""))),
        "does not fit on one line",
    ),
    "entities in entities": (zipped(("a.sml", ENTITIES + b"<a>&b;</a>")), "declares a document type"),
    "steps without end": (zipped(("a.sml", b"<a>" + b"<Step/>" * 20_000 + b"</a>")), "a sequence of 20000 steps"),
}


Outcome = dict[str, Any]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Outcome]]:
    """What became of every file, by kind. Nothing is written where the readers are, or beside the files."""
    folder = tmp_path_factory.mktemp("strangers")
    asked = {kind: written(folder / kind, kind) for kind in HOSTILE}
    before = sorted(folder.rglob("*"))
    ended = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("limited_reader.py"))],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        input=json.dumps(asked),
        check=False,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr
    assert sorted(folder.rglob("*")) == before
    found: dict[str, list[Outcome]] = {kind: [] for kind in HOSTILE}
    for line in ended.stdout.splitlines():
        outcome = json.loads(line)
        found[outcome["kind"]].append(outcome)
    return found


def written(folder: Path, kind: str) -> tuple[str, list[str]]:
    """Where the reader of a kind is to be, and the hostile files for it."""
    place, files = folder / "place", []
    place.mkdir(parents=True)
    for number, (content, _text) in enumerate(HOSTILE[kind].values()):
        name = "some.zip" if kind == "pictures" else "some.gz" if kind == "packed idx" else "some.toml"
        path = folder / str(number) / name
        path.parent.mkdir()
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            content(path)
        files.append(str(path))
    return str(place), files


@pytest.mark.parametrize("kind", HOSTILE)
def test_every_hostile_file_is_refused_in_one_line(kind: str, outcomes: dict[str, list[Outcome]]) -> None:
    wrong = [
        (what, outcome)
        for (what, (_, text)), outcome in zip(HOSTILE[kind].items(), outcomes[kind], strict=True)
        if outcome["refused"] != "as documented"
        or text not in outcome["text"]
        or not outcome["text"].isprintable()
        or len(outcome["text"]) > 1000
        or outcome["seconds"] > SECONDS
    ]
    assert not wrong
