"""Runs that lie elsewhere, on S3, behind SSH or HTTP, wherever fsspec reaches: to look at, and to put whole.

A folder elsewhere is listed once and then known as it was at that time: what is there, how large, of what kind. What is
requested after that is bytes, in blocks that are kept for a while. A `StorePath` is what readers take it for, a path,
and has what they ask of one; `location` makes it of a URL and is the only one who does. Nothing there is changed; a run
is put where none is. The extra `store`.
"""

import errno
import io
import re
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import import_module
from pathlib import Path, PurePosixPath
from threading import Lock
from typing import Any, cast
from urllib.parse import urlsplit

from labctl.errors import LabctlError, RunError, UsageError, one_line

BLOCK_BYTES = 1 << 20
BLOCKS_KEPT = 64
"""Of a folder elsewhere and all that is in it."""
MOST_ENTRIES = 1_000_000
DEEPEST = 5
"""Folders in one another that are looked through; a run among others has three."""
OBJECT_STORES = frozenset({"s3", "s3a", "gs", "gcs", "abfs", "az"})
"""They have keys and no folders: one listing names all of them, and none goes deeper for ever."""
CHANGES = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "updated", "created")
"""What a store may say of a file that is another when the file is."""
SILENT_S = 30
"""So long a server behind SSH may say nothing, in s, unless fsspec is configured otherwise."""
S3_ROUNDS = 2
"""Each is of five tries of botocore (`AWS_MAX_ATTEMPTS`), which wait longer every time for a store that throttles."""
LONGEST_REASON = 300
_URL = re.compile(r"([a-z][a-z0-9+.-]+)://(?!$)")
_PASSWORD = re.compile(r"(://[^/:]*):[^/]*@")


class Unreachable(LabctlError):
    """A store does not answer, or answers something else than it was asked: one line that says what to do."""

    exit_status = 1


def location(named: Path | str) -> Path:
    """What a person names: a path, or by its URL a place elsewhere, which stands in for a path that is only read.

    Nothing is requested yet. `file:///runs` is the folder `/runs`.

    Raises:
        UsageError: the URL leads outside of itself, or that of a folder here names a machine; or the name is empty,
            which would be the present folder.
    """
    if named == "":
        raise UsageError("a name is empty: name a folder (the shell may not know its variable)")
    if not isinstance(named, str) or (found := _URL.match(named)) is None:
        return named if isinstance(named, Path | StorePath) else Path(named)
    if found[1] in ("file", "local"):
        from urllib.request import url2pathname  # with HTTP and TLS, which take long to load

        parts = urlsplit(named)
        if parts.netloc not in ("", "localhost"):
            raise UsageError(f"{_shown(named)}: names a machine: write file:///..., or the path of the folder")
        return Path(url2pathname(parts.path))
    if ".." in PurePosixPath(named).parts:
        raise UsageError(f"{_shown(named)}: leads outside of itself: write it without ..")
    return cast(Path, StorePath(_Folder(named.rstrip("/"))))


def here(named: Path | str) -> Path:
    """What a person names, of a command that needs it on this machine.

    Raises:
        UsageError: it is elsewhere, or as `location`.
    """
    if isinstance(named, str) and _URL.match(named):
        if isinstance(location(named), StorePath):
            raise UsageError(
                f"{_shown(named)}: is elsewhere, and this needs it on this machine: copy it here, such as by rclone or "
                "scp, and name the copy"
            )
        raise UsageError(f"{named}: is on this machine: name it by its path, {location(named)}")
    return Path(location(named))


def is_elsewhere(path: Path) -> bool:
    """Whether a path stands for a place in a store."""
    return isinstance(path, StorePath)


def alone(path: Path) -> Path:
    """The same place by itself: of what lies in a store nothing is known yet, and nothing beside it is ever listed."""
    return cast(Path, path.alone()) if isinstance(path, StorePath) else path


def mended(path: Path, otherwise: str) -> str:
    """What to do about a damaged file of a run, or the run: `otherwise`, but where nothing is ever changed."""
    if not is_elsewhere(path):
        return otherwise
    return "nothing mends it there: remove the folder of its run, and measure it again or copy it there anew"


def written(place: Path) -> str:
    """A place as it is noted for later commands, from wherever they are typed.

    Raises:
        UsageError: there is a password in its URL.
    """
    if isinstance(place, StorePath) and place.has_password:
        raise UsageError(
            f"{place}: what needs a password in its URL is not found by later commands, as it is written nowhere: "
            "use an SSH key or mount the folder, and leave the password out"
        )
    return str(place if is_elsewhere(place) else place.absolute())


@dataclass(frozen=True)
class _Entry:
    """What a listing says of a file: its size, if it does, and a text that changes with it, empty for none."""

    size: int | None
    stamp: str


class _Folder:
    """What lies under a URL, as it was when it was first asked for."""

    def __init__(self, url: str) -> None:
        self.shown = _shown(url)
        self._url = url
        self.block = lru_cache(BLOCKS_KEPT)(self._block)
        self._turn = Lock()

    def __reduce__(self) -> "tuple[type[_Folder], tuple[str]]":
        """Another process lists it anew."""
        return _Folder, (self._url,)

    def within(self, inner: str) -> "_Folder":
        """A place in it as a folder of its own."""
        return _Folder(f"{self._url}/{inner}" if inner else self._url)

    @cached_property
    def _opened(self) -> tuple[Any, str]:
        try:
            core, config = import_module("fsspec.core"), import_module("fsspec.config")
        except ModuleNotFoundError:
            raise self._lacks("fsspec") from None
        ssh, s3 = self._url.startswith(("sftp:", "ssh:")), self._url.startswith(("s3:", "s3a:"))
        own = config.conf.get("sftp", {}) | config.conf.get("ssh", {})
        limits = {name: SILENT_S for name in ("timeout", "channel_timeout") if ssh and name not in own}
        try:
            system, root = core.url_to_fs(self._url, **limits)
            if ssh:  # the limit is for opening the channel: by itself, paramiko awaits answers in it for ever
                system.ftp.get_channel().settimeout(system.ssh_kwargs["channel_timeout"])
            elif s3:
                system.retries = min(system.retries, S3_ROUNDS)
        except ImportError as error:
            raise self._lacks(error.name or one_line(error)) from None
        except ValueError as error:
            raise UsageError(f"{self.shown}: {one_line(error)}: name a store as s3://, sftp:// or https://") from None
        except Exception as error:
            raise self._unreachable(self.shown, error) from error
        return system, root

    def _lacks(self, package: str) -> RunError:
        return RunError(f'{self.shown}: needs {package} to be read: pip install "photonic-labctl[store]"')

    @cached_property
    def _listed(self) -> tuple[dict[str, _Entry], dict[str, set[str]], str]:
        """Every file by its place under the URL, the names in every folder, and the first that is neither."""
        files: dict[str, _Entry] = {}
        folders: dict[str, set[str]] = {}
        strange = ""
        for inner, described in self._found().items():
            kind = described.get("type")
            strange = strange or (inner if kind not in ("file", "directory") else "")
            if kind == "directory":
                folders.setdefault(inner, set())
            else:
                size = described.get("size")
                stamp = next((f"{described[name]}" for name in CHANGES if described.get(name)), "")
                files[inner] = _Entry(size if isinstance(size, int) else None, stamp)
            for above in PurePosixPath(inner).parents if inner else ():
                folders.setdefault(_inner(above), set()).add(inner.removeprefix(f"{_inner(above)}/").partition("/")[0])
        for inner in folders:  # what has something in it is no file, whatever a web server calls it
            files.pop(inner, None)
        return files, folders, strange

    def _found(self) -> dict[str, Mapping[str, Any]]:
        system, root = self._opened
        try:
            system.invalidate_cache()
            if root.endswith(".h5"):  # a listing of what is a file might be the whole file
                return {"": system.info(root)}
            found = self._walked() if self._has_folders else self._inside(system.find(root, withdirs=True, detail=True))
        except FileNotFoundError as error:
            why = error.__cause__  # HTTP calls a file "not found" whatever it was answered, and where nobody answers
            if _is_web(root) and isinstance(why, Exception) and getattr(why, "status", None) != 404:
                raise self._unreachable(self.shown, why) from why
            return {}
        except Unreachable:
            raise
        except Exception as error:
            raise self._unreachable(self.shown, error) from error
        if len(found) > MOST_ENTRIES:
            raise RunError(f"{self.shown}: holds more than {MOST_ENTRIES} files: name a folder in it")
        return found

    def _walked(self) -> dict[str, Mapping[str, Any]]:
        """What is there, folder by folder. `find` takes one that the store refuses to list for an empty one."""
        system, root = self._opened
        # A web server calls nothing a folder that has no / at its end: what is one has something in its listing.
        found: dict[str, Mapping[str, Any]] = {"": {"type": "file"} if _is_web(root) else system.info(root)}
        folders = [""] if _is_web(root) or found[""]["type"] == "directory" else []
        for folder in folders:  # and in those that are found on the way
            try:
                listed = {one["name"]: one for one in system.ls(self._full(folder), detail=True)}
            except Exception as error:
                if not folder:
                    raise
                raise self._unreachable(self.name_of(folder), error) from error
            new = {inner: one for inner, one in self._inside(listed).items() if inner not in found}
            found |= new
            folders += [
                inner for inner, one in new.items() if one["type"] == "directory" and inner.count("/") < DEEPEST - 1
            ]
        return found

    def _inside(self, listed: Mapping[str, Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
        """What is listed, by its place under the URL; a page also has links to elsewhere."""
        above = self._opened[1].rstrip("/")
        inner = {
            name.rstrip("/").removeprefix(above).lstrip("/"): one
            for name, one in listed.items()
            if name.startswith(above)
        }
        return {
            name: one
            for name, one in inner.items()
            if not {"..", "."}.intersection(name.split("/")) and "?" not in name
        }

    @property
    def _has_folders(self) -> bool:
        protocol = self._opened[0].protocol
        return OBJECT_STORES.isdisjoint((protocol,) if isinstance(protocol, str) else protocol)

    @property
    def files(self) -> dict[str, _Entry]:
        """Every file."""
        return self._listed[0]

    @property
    def folders(self) -> dict[str, set[str]]:
        """What is in every folder."""
        return self._listed[1]

    @property
    def strange(self) -> str:
        """The first place that is neither file nor folder, or empty."""
        return self._listed[2]

    def name_of(self, inner: str) -> str:
        """How a place is called in messages."""
        return f"{self.shown}/{inner}" if inner else self.shown

    def url_of(self, inner: str) -> str:
        """Where a place is, with whatever password there is in it: never to be shown."""
        return f"{self._url}/{inner}" if inner else self._url

    def size(self, inner: str) -> int:
        """Bytes of a file; asked for where the listing does not say."""
        system, _ = self._opened
        size = self.files[inner].size
        if size is None:
            try:
                size = system.info(self._full(inner)).get("size")
            except Exception as error:
                raise self._unreachable(self.name_of(inner), error) from error
            if not isinstance(size, int):
                raise Unreachable(f"{self.name_of(inner)}: its server does not say how large it is: copy it here")
            self.files[inner] = _Entry(size, self.files[inner].stamp)
        return size

    def bytes_of(self, inner: str, start: int, end: int) -> bytes:
        """A stretch of a file: out of blocks that are kept, or a long one in one request."""
        end = min(end, self.size(inner))
        if end <= start:
            return b""
        first, last = start // BLOCK_BYTES, (end - 1) // BLOCK_BYTES
        if last - first > 1:
            return self._fetched(inner, start, end)
        found = b"".join(self.block(inner, number) for number in range(first, last + 1))
        return found[start - first * BLOCK_BYTES : end - first * BLOCK_BYTES]

    def _block(self, inner: str, number: int) -> bytes:
        start = number * BLOCK_BYTES
        return self._fetched(inner, start, min(start + BLOCK_BYTES, self.size(inner)))

    def _fetched(self, inner: str, start: int, end: int) -> bytes:
        system, _ = self._opened
        # Only what is asynchronous inside may be asked by several threads at a time: paramiko waits for ever.
        turn = nullcontext() if getattr(system, "async_impl", False) else self._turn
        try:
            with turn:
                found: bytes = system.cat_file(self._full(inner), start=start, end=end)
        except Exception as error:
            raise self._unreachable(self.name_of(inner), error) from error
        if len(found) != end - start:
            raise Unreachable(
                f"{self.name_of(inner)}: {end - start} bytes were asked for, {len(found)} came: it is another now, "
                "or its server gives whole files only: try again, or copy it here"
            )
        return found

    def make(self) -> None:
        """Make the folder and those above it, also where others are making them now; stores of keys have none."""
        system, root = self._opened
        place = PurePosixPath(root)
        for folder in reversed((place, *place.parents)) if self._has_folders else ():
            with suppress(Exception):  # somebody was quicker; or it will be refused and said when files are put there
                system.makedirs(str(folder), exist_ok=True)

    def put(self, files: Mapping[Path, str]) -> None:
        """Put files of this machine at places under the URL."""
        system, _ = self._opened
        try:
            system.put([str(path) for path in files], [self._full(inner) for inner in files.values()])
        except FileNotFoundError as error:
            raise RunError(
                f"{self.shown}: there is no such store ({one_line(error)}): name one that is there"
            ) from error
        except Exception as error:
            raise self._unreachable(self.shown, error, "written") from error

    def _full(self, inner: str) -> str:
        root = self._opened[1].rstrip("/")
        return f"{root}/{inner}" if inner else root

    def _unreachable(self, where: str, error: Exception, what: str = "read") -> Unreachable:
        why = _PASSWORD.sub(r"\1@", one_line(error) or type(error).__name__)[:LONGEST_REASON]
        return Unreachable(
            f"{where}: cannot be {what} ({why}): see to the connection, the name and your credentials, and try again"
        )


@dataclass(frozen=True, eq=False)
class StorePath:
    """A place in a store, with those of the methods of `pathlib.Path` that readers of runs call."""

    _folder: _Folder
    _inner: str = ""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StorePath) and str(self) == str(other)

    def __hash__(self) -> int:
        return hash(str(self))

    def __lt__(self, other: "StorePath") -> bool:
        return str(self) < str(other)

    def __str__(self) -> str:
        return self._folder.name_of(self._inner)

    def __reduce__(self) -> tuple[Any, ...]:
        """For another process, which lists the place itself."""
        return location, (self._folder.url_of(self._inner),)

    @property
    def has_password(self) -> bool:
        """Whether there is one in its URL, which no text of it has."""
        return self._folder.url_of(self._inner) != str(self)

    def anew(self) -> "StorePath":
        """The same place, to be listed again."""
        return StorePath(_Folder(self._folder.url_of(self._inner)))

    def __truediv__(self, name: str) -> "StorePath":
        return StorePath(self._folder, f"{self._inner}/{name}" if self._inner else name)

    @property
    def name(self) -> str:
        """The last part of it."""
        return str(self).rpartition("/")[2]

    @property
    def suffix(self) -> str:
        """The end of its name."""
        return PurePosixPath(self.name).suffix

    def exists(self) -> bool:
        """Whether it was there when the store was listed."""
        return self.is_file() or self.is_dir()

    def is_file(self) -> bool:
        """Whether it is no folder."""
        return self._inner in self._folder.files

    def is_dir(self) -> bool:
        """Whether it is a folder."""
        return self._inner in self._folder.folders

    def is_symlink(self) -> bool:
        """No: a listing in which one is, is refused."""
        return False

    def resolve(self) -> "StorePath":
        """Itself."""
        return self

    def iterdir(self) -> "list[StorePath]":
        """What is in it."""
        return [self / name for name in sorted(self._folder.folders.get(self._inner, ()))]

    def glob(self, pattern: str) -> "list[StorePath]":
        """What is in it and is called so."""
        return [one for one in self.iterdir() if PurePosixPath(one.name).match(pattern)]

    def stamp(self) -> str | None:
        """A text that changes with the file, or with any in the folder; None where the store says nothing of the kind.

        Raises:
            FileNotFoundError: there is no such file.
        """
        if self.is_dir():
            inside = [one.stamp() for one in self.iterdir()]
            return None if None in inside else " ".join(map(str, inside))
        self._require()
        entry = self._folder.files[self._inner]
        return f"{entry.size} {entry.stamp}" if entry.stamp else None

    def require_plain(self) -> None:
        """Refuse a folder that holds anything but files and folders.

        Raises:
            RunError: it does.
        """
        strange = self._folder.strange
        if strange and (not self._inner or strange.startswith(f"{self._inner}/")):
            raise RunError(f"{self._folder.name_of(strange)}: is a link or a device, which no run has: remove it")

    def alone(self) -> "StorePath":
        """The same place, of which nothing is known yet."""
        return StorePath(self._folder.within(self._inner))

    def put(self, folder: Path, last: str) -> None:
        """Put there what is in a folder of this machine, the file called `last` after all others.

        Raises:
            UsageError, RunError, Unreachable: there is no such store, its package is missing, or it refuses.
        """
        there = self._folder.within(self._inner)
        there.make()
        # Files only: for a folder S3 would make a bucket, and SSH has no way to put one.
        inside = {path: path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*")) if path.is_file()}
        there.put({path: inner for path, inner in inside.items() if inner != last})
        there.put({folder / last: last})

    def own_file(self, largest: int) -> "StoredFile":
        """It, to read, of at most `largest` bytes; they are requested as they are read.

        Raises:
            OSError: there is no such file, or it is larger.
        """
        self._require()
        size = self._folder.size(self._inner)
        if size > largest:
            raise OSError(errno.EFBIG, f"has {size} bytes, and no more than {largest} are read", str(self))
        return StoredFile(self._folder, self._inner, size)

    def _require(self) -> None:
        if not self.is_file():
            raise FileNotFoundError(errno.ENOENT, "no such file", str(self))


class StoredFile(io.RawIOBase):
    """A file of a store as any other that is read."""

    def __init__(self, folder: _Folder, inner: str, size: int) -> None:
        """Nothing is requested yet."""
        self._folder, self._inner, self._size = folder, inner, size
        self._place = 0

    def readable(self) -> bool:
        """Yes."""
        return True

    def seekable(self) -> bool:
        """Yes."""
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """As of any file."""
        self._place = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._place, io.SEEK_END: self._size}[whence]
        return self._place

    def tell(self) -> int:
        """As of any file."""
        return self._place

    def read(self, size: int = -1) -> bytes:
        """As of any file.

        Raises:
            Unreachable: the store does not answer.
        """
        end = self._size if size < 0 else min(self._place + size, self._size)
        found = self._folder.bytes_of(self._inner, self._place, end)
        self._place += len(found)
        return found

    def readall(self) -> bytes:
        """All that is left."""
        return self.read()

    def readinto(self, buffer: Any) -> int:
        """As of any file."""
        found = self.read(len(buffer))
        buffer[: len(found)] = found
        return len(found)


def _shown(url: str) -> str:
    """A URL as it may be printed: without the password in it."""
    return _PASSWORD.sub(r"\1@", url.rstrip("/"))


def _is_web(root: str) -> bool:
    return root.startswith(("http://", "https://"))


def _inner(path: PurePosixPath) -> str:
    return "" if path == PurePosixPath() else str(path)
