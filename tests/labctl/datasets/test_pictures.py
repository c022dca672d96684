import io
import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from labctl import datasets
from labctl.datasets import pictures, store
from labctl.datasets.cards import Card, card
from labctl.datasets.images import read_image_set
from labctl.errors import DatasetError

SHAPE = (6, 8)
FOLDERS = ("Negative", "Positive")


def jpeg(level: int, shape: tuple[int, int] = SHAPE, kind: str = "JPEG") -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.full((*shape, 3), level, np.uint8)).save(file, kind, quality=95)
    return file.getvalue()


FILES = {
    "Negative/00001.jpg": jpeg(200),
    "Negative/00002.jpg": jpeg(210),
    "Negative/00010.JPEG": jpeg(220),
    "Positive/00001.jpg": jpeg(10),
    "Positive/00001_1.jpg": jpeg(20),
}
LEVELS = [200, 210, 220, 10, 20]

in_any_folder = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def zipped(path: Path, files: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def unpacked(folder: Path, files: dict[str, bytes]) -> Path:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def tiny() -> Card:
    return card("cracks").model_copy(update={"shape": (5, *SHAPE)})


def problem_of(read: Callable[..., object], *arguments: object) -> str:
    """The text of the one error that reading may end in; empty if it succeeds."""
    try:
        read(*arguments)
    except DatasetError as error:
        return str(error)
    return ""


@pytest.fixture(params=["zip", "folders"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    others = {"manifest.csv": b"class,file", "Negative/notes.txt": b"none", "Negative/._00001.jpg": b"none"}
    if request.param == "zip":
        zipped(tmp_path / "some.zip", {**others, **FILES})
        return tmp_path
    return unpacked(tmp_path, {**FILES, **others})


def test_class_by_class_and_by_name(place: Path) -> None:
    read = read_image_set(tiny(), place)
    assert read.labels.tolist() == [0, 0, 0, 1, 1]
    assert read.indices.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(read.images.mean(axis=(1, 2)), LEVELS, atol=2)
    assert read.images.shape == (5, *SHAPE)
    assert "Özgenel" in read.source
    assert all(check.ok for check in store.check(tiny(), place))


def test_names_that_a_terminal_cannot_print_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "zip").mkdir()
    files = {**FILES, "Negative/\x1b[2J\n.jpg": b"damaged"}
    zipped(tmp_path / "zip" / "some.zip", files)
    for place in (unpacked(tmp_path / "folder", files), tmp_path / "zip"):
        assert len(read_image_set(tiny(), place)) == 5


def test_a_folder_that_may_not_be_read(tmp_path: Path) -> None:
    unpacked(tmp_path, FILES)
    (tmp_path / "Positive").chmod(0)
    try:
        if os.access(tmp_path / "Positive", os.R_OK):
            pytest.skip("this user may read everything")
        assert "Positive: cannot be read" in problem_of(read_image_set, tiny(), tmp_path)
    finally:
        (tmp_path / "Positive").chmod(0o700)


def test_only_what_was_chosen_is_decoded(place: Path) -> None:
    for path in place.rglob("00002.jpg"):
        path.write_bytes(b"damaged")
    read = read_image_set(tiny(), place, images=[1, 2])
    np.testing.assert_allclose(read.images.mean(axis=(1, 2)), [200, 10, 20], atol=2)
    assert read.indices.tolist() == [0, 3, 4]


def test_a_damaged_picture_is_named(tmp_path: Path) -> None:
    whole = FILES["Negative/00001.jpg"]
    unpacked(tmp_path, {**FILES, "Positive/00001.jpg": whole[: len(whole) // 2], "Negative/00002.jpg": jpeg(9, (6, 9))})
    with pytest.raises(DatasetError, match=r"Negative/00002\.jpg: is 6x9 pixels, the data set has 6x8"):
        read_image_set(tiny(), tmp_path)
    album, first, second = store.check(tiny(), tmp_path)
    assert album.ok
    assert (first.path.name, second.path.name) == ("00002.jpg", "00001.jpg")
    assert "is not a whole JPEG file" in second.problem


@pytest.mark.parametrize("kind", ["PNG", "GIF", "TIFF", "BMP"])
def test_only_jpeg_is_decoded_whatever_the_name(kind: str) -> None:
    with pytest.raises(DatasetError, match="x: is not a whole JPEG file"):
        pictures.decode(jpeg(5, kind=kind), "x", SHAPE)


def test_a_picture_that_would_unpack_to_gigabytes_is_refused_by_its_header() -> None:
    start = FILES["Negative/00001.jpg"].index(b"\xff\xc0")
    content = bytearray(FILES["Negative/00001.jpg"])
    content[start + 5 : start + 9] = struct.pack(">HH", 65500, 65500)
    with pytest.raises(DatasetError, match="65500x65500"):
        pictures.decode(bytes(content), "x", SHAPE)


@given(st.data())
def test_any_bytes_are_a_picture_or_the_one_error(data: st.DataObject) -> None:
    content = bytearray(FILES["Negative/00001.jpg"])
    for _ in range(data.draw(st.integers(0, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(content[: data.draw(st.integers(0, len(content)))])
    album = pictures.Album(Path("p"), ("Negative/x.jpg",), np.array([0]), lambda _name: cut)
    assert "\n" not in problem_of(album.pictures, np.array([0]), SHAPE)


@given(data=st.data())
@in_any_folder
def test_any_damage_to_a_zip_file_gives_pictures_or_the_one_error(data: st.DataObject, tmp_path: Path) -> None:
    path = zipped(tmp_path / "some.zip", FILES, data.draw(st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])))
    content = bytearray(path.read_bytes())
    directory = content.index(b"PK\x01\x02")
    for _ in range(data.draw(st.integers(1, 6))):
        first = data.draw(st.sampled_from([0, directory, len(content) - 22]))
        content[data.draw(st.integers(first, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.just(len(content)) | st.integers(0, len(content)))])
    assert "\n" not in problem_of(read_image_set, tiny(), tmp_path)
    assert all("\n" not in check.problem for check in store.check(tiny(), tmp_path))


@given(content=st.binary(max_size=200))
@in_any_folder
def test_any_bytes_called_zip_give_the_one_error(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "some.zip").write_bytes(content)
    with pytest.raises(DatasetError, match=r"some\.zip"):
        read_image_set(tiny(), tmp_path)


@pytest.mark.parametrize(
    "name", ["../Negative/1.jpg", "/etc/1.jpg", "Negative/../../1.jpg", "..\\1.jpg", "C:/Negative/1.jpg"]
)
def test_an_archive_that_names_other_places_is_refused(name: str, tmp_path: Path) -> None:
    zipped(tmp_path / "some.zip", {**FILES, name: jpeg(3)})
    with pytest.raises(DatasetError, match="a place outside the archive"):
        read_image_set(tiny(), tmp_path)


def test_a_member_that_unpacks_to_more_than_a_picture_is_refused(tmp_path: Path) -> None:
    zipped(tmp_path / "some.zip", {**FILES, "Negative/bomb.jpg": bytes(1 << 24)})
    with pytest.raises(DatasetError, match=r"bomb\.jpg' unpacks to 16777216 bytes"):
        read_image_set(tiny(), tmp_path)


def test_a_member_that_lies_about_its_size_is_refused(tmp_path: Path) -> None:
    bomb = bytes(1 << 24)
    path = zipped(tmp_path / "some.zip", {**FILES, "Negative/00000.jpg": bomb})
    path.write_bytes(path.read_bytes().replace(struct.pack("<I", len(bomb)), struct.pack("<I", 5000)))
    with pytest.raises(DatasetError, match=r"00000\.jpg"):
        read_image_set(tiny(), tmp_path)


def test_a_large_file_in_a_folder_is_refused(tmp_path: Path) -> None:
    unpacked(tmp_path, {**FILES, "Negative/00000.jpg": FILES["Negative/00001.jpg"] + bytes(1 << 20)})
    with pytest.raises(DatasetError, match=r"00000\.jpg is larger than"):
        read_image_set(tiny(), tmp_path)


def test_too_many_pictures_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "MAX_PICTURES", 4)
    (tmp_path / "zip").mkdir()
    zipped(tmp_path / "zip" / "some.zip", FILES)
    for place in (unpacked(tmp_path / "folder", FILES), tmp_path / "zip"):
        with pytest.raises(DatasetError, match="4"):
            read_image_set(tiny(), place)


def test_a_long_table_of_contents_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = zipped(tmp_path / "some.zip", FILES)
    content = bytearray(path.read_bytes())
    content[-10:-6] = struct.pack("<I", 100 << 20)
    path.write_bytes(content)
    with pytest.raises(DatasetError, match="table of contents of 104857600 bytes"):
        read_image_set(tiny(), tmp_path)


def test_a_huge_archive_is_refused(tmp_path: Path) -> None:
    path = zipped(tmp_path / "some.zip", FILES)
    os.truncate(path, (1 << 30) + 1)
    with pytest.raises(DatasetError, match="is 1073741825 bytes"):
        read_image_set(tiny(), tmp_path)


def test_an_archive_of_the_64_bit_kind_is_refused(tmp_path: Path) -> None:
    path = zipped(tmp_path / "some.zip", FILES)
    content = path.read_bytes()
    path.write_bytes(content[:-22] + b"PK\x06\x07" + bytes(16) + content[-22:])
    with pytest.raises(DatasetError, match="64-bit kind"):
        read_image_set(tiny(), tmp_path)


@pytest.mark.parametrize("field", ["encrypted", "compression"])
def test_an_archive_packed_unusually_is_refused(field: str, tmp_path: Path) -> None:
    compression = zipfile.ZIP_BZIP2 if field == "compression" else zipfile.ZIP_DEFLATED
    path = zipped(tmp_path / "some.zip", FILES, compression)
    if field == "encrypted":
        content = bytearray(path.read_bytes())
        content[content.index(b"PK\x01\x02") + 8] |= 1
        path.write_bytes(content)
    with pytest.raises(DatasetError, match="encrypted or packed in an unusual way"):
        read_image_set(tiny(), tmp_path)


def test_two_of_one_name_are_refused(tmp_path: Path) -> None:
    path = zipped(tmp_path / "some.zip", FILES)
    path.write_bytes(path.read_bytes().replace(b"Positive/00001_1.jpg", b"Negative/00010.JPEG"))
    with pytest.raises(DatasetError, match=r"some\.zip"):
        read_image_set(tiny(), tmp_path)


def test_an_archive_without_one_class_is_refused(tmp_path: Path) -> None:
    zipped(tmp_path / "some.zip", {"Negative/1.jpg": jpeg(1), "Positive/readme.txt": b""})
    with pytest.raises(DatasetError, match="holds no JPEG file in Positive/"):
        read_image_set(tiny(), tmp_path)


def test_several_archives_are_too_many(tmp_path: Path) -> None:
    zipped(tmp_path / "a.zip", FILES)
    zipped(tmp_path / "b.zip", FILES)
    with pytest.raises(DatasetError, match=r"one zip file with them \(found: a\.zip, b\.zip\)"):
        read_image_set(tiny(), tmp_path)
    (problem,) = store.check(tiny(), tmp_path)
    assert "a.zip, b.zip" in problem.problem


def test_the_real_cracks() -> None:
    """The subset as published: sizes, classes, and that cracks are darker than concrete."""
    if problem_of(datasets.path, "cracks"):
        pytest.skip("LABCTL_DATA does not point to the METU cracks")
    read = datasets.load("cracks", images=[60, 40], seed=3)
    assert read.images.shape == (100, 227, 227)
    dark = ~read.binarised("median-0.7").images
    assert dark[read.labels == 1].mean() > 3 * dark[read.labels == 0].mean()
