"""Texts of fixed length, and files that do not keep them so."""

import io
from collections.abc import Callable

import h5py
import numpy as np
import pytest

from labctl.runs.format.global_heaps import HEAP
from labctl.runs.format.plain_hdf5 import LIBVER, attribute, check_plain, set_text, walked


def written(fill: Callable[[h5py.File], object]) -> bytes:
    image = io.BytesIO()
    with h5py.File(image, "w", libver=LIBVER) as file:
        set_text(file, "format_version", "1.2")
        fill(file)
    return image.getvalue()


@pytest.mark.parametrize("text", ["", "1.2", "größer", "ä" * 40_000, "x" * 2_000_000])
def test_a_text_of_any_length_comes_back_and_lies_in_no_heap(text: str) -> None:
    image = written(lambda file: set_text(file.create_group("group"), "text", text))
    assert HEAP not in image
    with walked(image) as file:
        assert attribute(file["group"], "text") == text


def test_numbers_come_back() -> None:
    def fill(file: h5py.File) -> None:
        file.attrs["one"] = 2.5
        file.attrs["some"] = [1, 2]

    with walked(written(fill)) as file:
        assert attribute(file, "one") == 2.5
        with pytest.raises(ValueError, match="'some' has several values"):
            attribute(file, "some")
        with pytest.raises(KeyError):
            attribute(file, "other")


def test_a_text_of_variable_length_is_read_in_older_files_alone() -> None:
    def fill(file: h5py.File) -> None:
        file.attrs["text"] = "some"

    def of_older_format(file: h5py.File) -> None:
        fill(file)
        file.attrs["format_version"] = "1.1"
        file["texts"] = ["some", "texts"]

    with walked(written(fill)) as file, pytest.raises(ValueError, match="'text' is a text of variable length"):
        attribute(file, "text")
    with walked(written(of_older_format)) as file:
        check_plain(file, 1 << 20)
        assert attribute(file, "text") == "some"


def test_texts_of_variable_length_in_an_array_are_refused() -> None:
    def fill(file: h5py.File) -> None:
        file["texts"] = np.array(["some", "texts"], h5py.string_dtype())

    with walked(written(fill)) as file, pytest.raises(ValueError, match="'texts' holds texts of variable length"):
        check_plain(file, 1 << 20)
