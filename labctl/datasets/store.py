"""Where the files of a data set lie, how they get there, and whether they are what their card says."""

import gzip
import hashlib
import os
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from platformdirs import user_cache_path

from labctl.datasets import archives, pictures
from labctl.datasets.cards import Card, DataFile, bundled_directory
from labctl.errors import DatasetError, writing

DIRECTORY_VARIABLE = "LABCTL_DATA"
DOWNLOAD_TIMEOUT_S = 60
MAX_FILE_BYTES = 1 << 27
"""Of one file, packed or unpacked, on disk or from the network: the largest of a card has 47 MB."""


@dataclass(frozen=True)
class FileCheck:
    """Outcome of checking one file: `problem` is empty if its content has the digest on the card."""

    path: Path
    problem: str

    @property
    def ok(self) -> bool:
        """True if nothing is wrong with the file."""
        return not self.problem


def cache_directory() -> Path:
    """The user's cache folder for downloaded data sets (on Linux below XDG_CACHE_HOME).

    Raises:
        DatasetError: The user has no home.
    """
    try:
        return user_cache_path("labctl")
    except RuntimeError:
        raise DatasetError(
            f"this user has no home to keep data sets in: set XDG_CACHE_HOME to a folder, or {DIRECTORY_VARIABLE} to "
            f"one that holds the data sets"
        ) from None


def places(card: Card, directory: Path | None = None) -> Iterator[Path]:
    """Folders that may hold the files of `card`, in order of precedence.

    Args:
        card: Which data set.
        directory: Folder named by the user: it holds the data set's folder, or is that folder.
    """
    if card.bundled:
        yield bundled_directory() / card.folder
        return
    if directory is not None:
        yield directory / card.folder
        yield directory
    if variable := os.environ.get(DIRECTORY_VARIABLE):
        yield Path(variable) / card.folder
    yield cache_directory() / card.folder


def locate(card: Card, directory: Path | None = None) -> Path:
    """The first folder that holds every file of `card`, or its pictures; contents are not checked.

    Raises:
        DatasetError: No place holds them all.
    """
    for folder in places(card, directory):
        if _holds(folder, card):
            return folder
    looked = ", ".join(str(folder) for folder in places(card, directory))
    remedy = f"run 'labctl data fetch {card.name}', or set {DIRECTORY_VARIABLE} to a folder that holds {card.folder}/"
    if card.bundled:
        remedy = "the installation is incomplete, install labctl again"
    elif card.obtain:
        remedy = card.obtain
    raise DatasetError(f"data set '{card.name}' not found (looked in {looked}): {remedy}")


def _holds(folder: Path, card: Card) -> bool:
    if card.folders:
        return pictures.holds(folder, card.folders)
    return all((folder / file.name).is_file() for file in card.files)


def obtained(card: Card, directory: Path | None = None) -> Path:
    """The folder of the files of `card`, which are downloaded if no place holds them.

    Raises:
        DatasetError: No place holds them, and they cannot be downloaded.
    """
    try:
        return locate(card, directory)
    except DatasetError:
        return download(card)


def download(card: Card, cache: Path | None = None) -> Path:
    """Download what is missing of `card` into the cache, checking every digest; returns the folder.

    Args:
        card: Which data set.
        cache: Cache folder; None = the user's.

    Raises:
        DatasetError: The source cannot be reached, or it served something else than the card says, or the data set is
            one that users must get by hand.
        NotWritten: The cache cannot be made.
    """
    if card.bundled or card.obtain:
        return locate(card)
    folder = (cache or cache_directory()) / card.folder
    with writing(folder, f"set {DIRECTORY_VARIABLE} to a folder that holds the data set"):
        folder.mkdir(parents=True, exist_ok=True)
    for file in card.files:
        try:
            _retrieve(card, file, folder)
        except OSError as error:
            raise DatasetError(
                f"data set '{card.name}' is not on this machine and {card.source} cannot be reached "
                f"({type(error).__name__}): set {DIRECTORY_VARIABLE} to a folder that holds {card.folder}/{file.name} "
                "and the other files of its card"
            ) from error
        except (ValueError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
            raise DatasetError(
                f"{card.source}{file.name}: what was downloaded is not the file on the card (its sha256 differs): set "
                f"{DIRECTORY_VARIABLE} to a folder that holds {card.folder}/ from another source"
            ) from error
    return folder


def _retrieve(card: Card, file: DataFile, folder: Path) -> None:
    """Download one file into `folder`, unless it is there; of an archive only the file itself is kept."""
    remote, digest = (file.archive.name, file.archive.sha256) if file.archive else (file.name, file.sha256_gz)
    if file.archive and (folder / file.name).is_file():
        return
    import pooch  # takes long to load, and nobody who has the files needs it

    downloaded = pooch.retrieve(
        card.source + remote,
        known_hash=f"sha256:{digest}",
        fname=Path(remote).name,
        path=folder,
        downloader=_download,
    )
    if file.archive:
        with zipfile.ZipFile(downloaded) as archive:  # of its publisher: the digest was checked
            content = archives.content(archive, file.archive.member, MAX_FILE_BYTES)
        part = folder / f"{file.name}.part"
        part.write_bytes(content)
        part.replace(folder / file.name)
        Path(downloaded).unlink()


class _Bounded:
    """A file that takes so many bytes, and no more."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._left = MAX_FILE_BYTES

    def write(self, data: bytes) -> int:
        self._left -= len(data)
        if self._left < 0:
            raise ValueError(f"more than {MAX_FILE_BYTES} bytes were sent")
        return self._file.write(data)

    def flush(self) -> None:
        self._file.flush()


def _download(url: str, output_file: str, retriever: object) -> None:
    """What pooch calls for each file: its own downloader, stopped where a server sends without end."""
    import pooch

    with Path(output_file).open("wb") as file:
        pooch.HTTPDownloader(timeout=DOWNLOAD_TIMEOUT_S)(url, _Bounded(file), retriever)


def version(folder: Path, file: DataFile) -> tuple[int, int]:
    """When a file was written (ns) and its length (bytes), which tell whether it is still the same; 0 if missing."""
    try:
        found = (folder / file.name).stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size


def read(folder: Path, file: DataFile) -> bytes:
    """The decompressed content of one file.

    Raises:
        DatasetError: The file cannot be read, or its content differs from what the card says.
    """
    path = folder / file.name
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            content = stream.read(MAX_FILE_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise DatasetError(f"{path}: cannot be read ({error}): replace the file") from error
    if len(content) > MAX_FILE_BYTES:
        raise DatasetError(f"{path}: holds more than {MAX_FILE_BYTES} bytes: replace the file")
    found = hashlib.sha256(_joined(content) if file.role == "table" else content).hexdigest()
    if found != file.sha256:
        raise DatasetError(f"{path}: sha256 is {found[:12]}..., expected {file.sha256[:12]}...: replace the file")
    return content


def _joined(table: bytes) -> bytes:
    """The rows of a table, without empty ones, with their fields joined by single commas."""
    rows = (b",".join(row.replace(b",", b" ").split()) for row in table.splitlines())
    return b"\n".join(row for row in rows if row)


def check(card: Card, folder: Path) -> tuple[FileCheck, ...]:
    """Check every file of `card` in `folder` against its digest; pictures, which have none, by decoding every one."""
    if card.folders:
        return _check_pictures(card, folder)

    def problem(file: DataFile) -> str:
        try:
            read(folder, file)
        except DatasetError as error:
            return str(error)
        return ""

    return tuple(FileCheck(folder / file.name, problem(file)) for file in card.files)


def _check_pictures(card: Card, folder: Path) -> tuple[FileCheck, ...]:
    """One check of the whole album, and one of each picture that is wrong."""
    try:
        with pictures.opened(folder, card.folders) as album:
            wrong = tuple(album.problems((card.shape[1], card.shape[2])))
            return FileCheck(album.place, ""), *(FileCheck(album.place / name, text) for name, text in wrong)
    except DatasetError as error:
        return (FileCheck(folder, str(error)),)
