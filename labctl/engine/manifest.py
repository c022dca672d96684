"""The manifest of a run: what was asked for, who the instruments are and how they are set, and what made the run."""

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from instruments.bench import Bench
from instruments.values import Identity
from labctl.engine.plan import Request
from labctl.runs.format.manifest import REPLAY
from labctl.runs.format.provenance import git_revision, versions
from protocols.base import Images, Inputs, Measurement


def manifest(request: Request, bench: Bench, identities: Mapping[str, Identity], started: datetime) -> dict[str, Any]:
    """What manifest.json holds beside the sizes that the writer adds; the bench stays dark.

    Raises:
        InstrumentError: an instrument does not answer, or the laser does not settle.
    """
    protocol = request.protocol
    light, instruments = light_and_instruments(request, bench, identities)
    return {
        "protocol": {
            "name": protocol.name,
            "digest": protocol.digest(),
            "settings": protocol.model_dump(mode="json"),
            **_own_file(protocol),
        },
        "station": request.station.model_dump(mode="json"),
        "light": light,
        "instruments": instruments,
        "calibration": request.calibration,
        **({"coordinates": dict(request.coordinates)} if request.coordinates else {}),
        **({REPLAY: [one.model_dump() for one in request.played]} if request.played else {}),
        "inputs_sha256": request.inputs.digest,
        "inputs_source": request.inputs.source,
        **_identical(request.inputs),
        "started": started.isoformat(timespec="seconds"),
        "versions": versions(),
        "git_revision": git_revision(),
        "seeds": {
            "seed": protocol.seed,
            "twin_seed": request.station.sim.twin_seed if request.station.simulated else None,
        },
    }


def _identical(inputs: Inputs) -> dict[str, int]:
    """How many images show what another one shows, though they have groups of their own; nothing where none does."""
    count = inputs.identical if isinstance(inputs, Images) else 0
    return {"identical_images": count} if count else {}


def _own_file(protocol: Measurement[Any]) -> dict[str, Any]:
    """The file that defines a protocol which comes from no package, and what only it can say."""
    if (file := protocol.source_file) is None:
        return {}
    said = {"path": str(file.path), "sha256": file.sha256, "text": file.text}
    return {"file": said, "judgement": protocol.judgement}


def light_and_instruments(
    request: Request, bench: Bench, identities: Mapping[str, Identity]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the laser settled on for the first pass, in the dark, and who all instruments are and how they are set."""
    light = vars(bench.set_light(request.protocol.passes(bench)[0].wavelength_nm))
    return light, {
        name: {"identity": vars(identities[name]), "settings": instrument.settings()}
        for name, instrument in bench.instruments.items()
    }
