"""A folder to give away: the files of a run, a list of their checksums, and metadata. It is a run itself."""

import hashlib
from collections.abc import Callable, Mapping
from datetime import date
from pathlib import Path

from labctl.errors import RunError, UsageError
from labctl.runs.export.file import aside, require_room
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.own_files import own_file, require_own_files
from labctl.runs.index import is_running
from labctl.runs.live.control_file import CONTROL
from labctl.runs.live.glimpse import GLIMPSE
from labctl.runs.live.sight import LOOKED
from labctl.runs.publication import as_datacite, as_ro_crate
from labctl.runs.publication.declaration import Declaration
from labctl.runs.publication.subject import Subject

CHECKSUMS = "SHA256SUMS"
"""As `sha256sum -c` reads it."""
PIECE_BYTES = 1 << 20
Files = Mapping[str, tuple[int, str]]
"""Size and SHA-256 of each file by its place in the folder, with forward slashes."""

FORMATS: Mapping[str, tuple[str, Callable[[Subject, Declaration, Files, date], bytes]]] = {
    "ro-crate": (as_ro_crate.FILE, as_ro_crate.encode),
    "datacite": (as_datacite.FILE, as_datacite.encode),
}
"""File of each kind of metadata, and what makes its bytes."""


def publish(run: Path, out: Path, to: str, said: Declaration, published: date) -> Subject:
    """Copy a run into a new folder, with checksums and the metadata `to`, one of `FORMATS`; all or nothing.

    A run that is unfinished, damaged, in doubt or simulated says so first of all in its metadata.

    Raises:
        UsageError: something that the metadata need was not said.
        RunError: not a run, or one that is being measured; the folder is there already, or cannot be written.
    """
    paths = RunPaths(run)
    require_own_files(run)
    if out.exists():
        raise RunError(f"{out}: exists: name another folder by --out")
    if run.resolve() in out.resolve().parents:
        raise RunError(f"{out}: lies in the run itself: name a folder elsewhere by --out")
    if is_running(paths):
        raise RunError(f"{run}: is being measured: wait for its end, or stop it, and publish it then")
    name, encode = FORMATS[to]
    subject = Subject.of(paths)
    encode(subject, said, {}, published)  # what is missing is said before a long copy
    found = sorted(path for path in run.rglob("*") if path.is_file() and _belongs(path))
    require_room(out, sum(path.stat().st_size for path in found), "make room")
    with aside(out) as folder:
        files = {(place := path.relative_to(run).as_posix()): _copied(path, folder / place) for path in found}
        metadata = encode(subject, said, files, published)
        (folder / name).write_bytes(metadata)
        digests = {place: digest for place, (_, digest) in files.items()} | {name: hashlib.sha256(metadata).hexdigest()}
        lines = "".join(f"{digest}  {place}\n" for place, digest in digests.items())
        (folder / CHECKSUMS).write_bytes(lines.encode("utf-8", "surrogateescape"))
    return subject


def _belongs(path: Path) -> bool:
    """Whether a file is worth giving away: of the run, not of whoever watched it, asked it or published it before."""
    if not path.name.isprintable() or "\\" in path.name:
        raise UsageError(f"{path}: a file of that name has no place in a list of checksums: rename it")
    made = {CHECKSUMS, *(name for name, _ in FORMATS.values())}
    return (
        path.name not in {CONTROL, GLIMPSE, LOOKED, *made} and path.suffix != ".tmp" and not path.name.startswith(".")
    )


def _copied(path: Path, to: Path) -> tuple[int, str]:
    to.parent.mkdir(parents=True, exist_ok=True)
    digest, size = hashlib.sha256(), 0
    with own_file(path) as source, to.open("xb") as target:
        while piece := source.read(PIECE_BYTES):
            digest.update(piece)
            size += target.write(piece)
    return size, digest.hexdigest()
