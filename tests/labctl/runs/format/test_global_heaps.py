"""Heaps in which HDF5 would walk for ever: such a file is refused before HDF5 sees them."""

import struct
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from labctl.runs.format.global_heaps import FILE, HEAP
from labctl.runs.format.plain_hdf5 import walked

LONG = "x" * 20_000


def written(libver: tuple[str, str], fill: Callable[[h5py.File], None]) -> bytes:
    with h5py.File("file", "w", driver="core", backing_store=False, libver=libver) as file:
        file.attrs["short"] = "1.1"
        fill(file)
        file.flush()
        image: bytes = file.id.get_file_image()
    return image


@pytest.fixture(params=[("v108", "v108"), ("earliest", "latest")])
def image(request: pytest.FixtureRequest) -> bytes:
    """With one heap: a text, and free space behind it."""
    return written(request.param, lambda _file: None)


def first_text(image: bytes) -> int:
    return image.index(HEAP) + 16


def free_space(image: bytes) -> int:
    return first_text(image) + 16 + 8


@pytest.mark.parametrize("libver", [("v108", "v108"), ("earliest", "latest")])
def test_a_sound_file_is_read_as_it_is(libver: tuple[str, str], tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file.attrs["long"] = LONG
        file["texts"] = ["some", "texts"] * 300
        file["numbers"] = np.arange(1 << 18)

    path = tmp_path / "some.h5"
    image = written(libver, fill)
    path.write_bytes(image)
    for file in (walked(path), walked(image)):
        with file:
            assert (file.attrs["short"], file.attrs["long"]) == ("1.1", LONG)
            assert file["texts"].asstr()[:4].tolist() == ["some", "texts", "some", "texts"]
            assert np.array_equal(file["numbers"][:], np.arange(1 << 18))


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("place_in", "size"),
    [(free_space, 0), (free_space, 8), (free_space, 1 << 40), (first_text, 2**64 - 16), (first_text, 1 << 40)],
    ids=["no free space", "less than a header", "beyond the end", "round the corner", "longer than the heap"],
)
def test_a_heap_that_goes_in_circles_is_refused(place_in: Callable[[bytes], int], size: int, image: bytes) -> None:
    harmed = bytearray(image)
    struct.pack_into("<Q", harmed, place_in(image) + 8, size)
    with walked(bytes(harmed)) as file, pytest.raises(OSError, match="do not lie one behind the other"):
        file.attrs["short"]


@pytest.mark.timeout(60)
def test_a_virtual_data_set_whose_heap_goes_in_circles_is_refused() -> None:
    """HDF5 reads where its data are as soon as it is opened, without any text in the file."""

    def fill(file: h5py.File) -> None:
        del file.attrs["short"]
        layout = h5py.VirtualLayout((4,), "i4")
        layout[...] = h5py.VirtualSource("other.h5", "data", (4,))
        file.create_virtual_dataset("virtual", layout)

    harmed = bytearray(written(("earliest", "latest"), fill))
    first = harmed.rindex(HEAP) + 16
    (size,) = struct.unpack_from("<Q", harmed, first + 8)
    struct.pack_into("<Q", harmed, first + 16 + -(-size // 8) * 8 + 8, 0)
    with walked(bytes(harmed)) as file, pytest.raises((OSError, KeyError), match=r"."):
        file["virtual"]


def test_lengths_of_four_bytes_are_refused(image: bytes) -> None:
    harmed = bytearray(image)
    harmed[14 if image[8] < 2 else 10] = 4
    with pytest.raises(OSError, match="not eight bytes"):
        walked(bytes(harmed))


@pytest.mark.parametrize(
    "content",
    [b"", b"short", FILE, FILE + b"\2\x08\x08\0" + b"\xfe" * 60, b"no HDF5 file, but longer than a header" * 50],
)
def test_other_files_are_none(content: bytes) -> None:
    with pytest.raises(OSError, match=r"."):
        walked(content)


@pytest.mark.timeout(60)
def test_a_heap_beyond_the_end_of_any_file_is_refused(image: bytes) -> None:
    harmed = bytearray(image)
    struct.pack_into("<Q", harmed, image.index(HEAP) + 8, 2**64 - 1)
    struct.pack_into("<Q", harmed, first_text(image) + 8, 2**63)
    with walked(bytes(harmed)) as file, pytest.raises(OSError, match=r"."):
        file.attrs["short"]
