"""What a run measured, from its manifest: the protocol as it was asked for, and what was shown or played."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from labctl.bench.own_files import is_own
from labctl.errors import RunError
from protocols.base import Inputs, Measurement, ProtocolError
from protocols.own_file import read_source
from protocols.registry import protocol_class, protocol_of, with_settings


def protocol_of_manifest(directory: Path, manifest: Mapping[str, Any]) -> Measurement[Any]:
    """The protocol as it was asked for.

    One that a file defines is executed only where a run was begun here with that file as it is now.

    Raises:
        RunError: the manifest does not say, its file is another one, or this version of labctl takes the settings
            otherwise.
        ProtocolError: no such protocol any more, or no such setting.
    """
    try:
        asked = manifest["protocol"]
        found = protocol_class(asked["name"]) if "file" not in asked else own_protocol(directory, **asked["file"])
        protocol = with_settings(found, asked["settings"], origin=str(directory))
        digest = asked["digest"]
    except (KeyError, TypeError, AttributeError) as error:
        raise RunError(f"{directory}: the manifest has no protocol settings: begin a new run") from error
    if protocol.digest() != digest:
        raise RunError(
            f"{directory}: this version of labctl reads the protocol's settings differently: resume with the version "
            f"that the manifest names, or begin a new run"
        )
    return protocol


def own_protocol(directory: Path, path: str, sha256: str, **_: object) -> type[Measurement[Any]]:
    """The protocol of a Python file that `directory` names, if a run was begun here with that very file.

    Raises:
        RunError: the file is not there, says something else, or nobody has begun a run with it here.
        ProtocolError: it defines no protocol on this machine.
    """
    try:
        source = read_source(Path(path))
    except ProtocolError as error:
        raise RunError(f"{directory}: the file with its protocol: {error}") from None
    if source.sha256 != sha256 or not is_own(source.path, source.content):
        raise RunError(
            f"{directory}: no run was begun here with the protocol {path!r} as it is now: restore its text from the "
            f"manifest of the run, or begin a new run"
        )
    return protocol_of(source)


def refuse_other_inputs(directory: Path, manifest: Mapping[str, Any], inputs: Inputs) -> None:
    """Compare what is shown or played with what was.

    Raises:
        RunError: the data set has changed.
    """
    if inputs.digest != manifest.get("inputs_sha256"):
        raise RunError(
            f"{directory}: the data set differs from the one that the run was begun with: name its folder by --data, "
            f"or begin a new run"
        )
