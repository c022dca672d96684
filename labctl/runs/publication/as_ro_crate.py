"""An RO-Crate: what is in the folder and where it came from, as JSON-LD. Source: w3id.org/ro/crate/1.1."""

import json
from collections.abc import Mapping
from datetime import date
from typing import Any
from urllib.parse import quote

from labctl.runs.publication.declaration import Declaration, Person
from labctl.runs.publication.subject import Subject

FILE = "ro-crate-metadata.json"
CRATE = "https://w3id.org/ro/crate/1.1"
KINDS = {
    ".h5": "application/x-hdf5",
    ".json": "application/json",
    ".jsonl": "application/jsonl",
    ".html": "text/html",
    ".png": "image/png",
    ".pdf": "application/pdf",
}
Entity = dict[str, Any]


def encode(subject: Subject, said: Declaration, files: Mapping[str, tuple[int, str]], published: date) -> bytes:
    """The bytes of `FILE`; `files` have size and SHA-256 by their place in the crate."""
    creators = [_person(one, f"#creator-{number}") for number, one in enumerate(said.creators, start=1)]
    instruments = [_instrument(role, identity) for role, identity in subject.instruments]
    comments = [
        {"@id": f"#note-{number}", "@type": "Comment", "text": one.text, "dateCreated": one.time, "author": one.by}
        for number, one in enumerate(subject.notes.notes, start=1)
    ]
    settings = [
        {"@id": f"#setting-{name}", "@type": "PropertyValue", "name": name, "value": json.dumps(value)}
        for name, value in subject.protocol[1].items()
    ]
    operator = [_person(Person(subject.notes.operator), "#operator")] if subject.notes.operator else []
    publisher = [{"@id": "#publisher", "@type": "Organization", "name": said.publisher}] if said.publisher else []
    parts = [
        {
            "@id": quote(name, errors="surrogateescape"),
            "@type": "File",
            "name": name,
            "contentSize": str(size),
            "encodingFormat": KINDS.get(f".{name.rpartition('.')[2]}", "text/plain"),
            "sha256": digest,
        }
        for name, (size, digest) in files.items()
    ]
    software = {"@id": "#labctl", "@type": "SoftwareApplication", "name": "labctl", "softwareVersion": subject.software}
    protocol = {
        "@id": "#protocol",
        "@type": "CreativeWork",
        "name": subject.protocol[0],
        "additionalProperty": _ids(settings),
    }
    measurement: Entity = {
        "@id": "#measurement",
        "@type": "CreateAction",
        "name": f"{subject.marks}run {subject.name}",
        "description": " ".join(subject.faults) or "Complete and intact.",
        "startTime": subject.started,
        "instrument": _ids([*instruments, software]),
        "object": {"@id": "#protocol"},
        "result": {"@id": "./"},
        "agent": _one_or_more(operator or creators),
    }
    root: Entity = {
        "@id": "./",
        "@type": "Dataset",
        "name": f"{subject.marks}{said.title}",
        "description": subject.description(said.description),
        "datePublished": published.isoformat(),
        "dateCreated": subject.started,
        "license": {"@id": said.licence_url},
        "creator": _one_or_more(creators),
        "author": _one_or_more(creators),
        "keywords": [
            *(fault.partition(":")[0].lower() for fault in subject.faults),
            subject.protocol[0],
            *subject.notes.tags,
        ],
        "creativeWorkStatus": "Incomplete" if not subject.report.complete else "Complete",
        "hasPart": _ids(parts),
        "mentions": {"@id": "#measurement"},
        **({"comment": _ids(comments)} if comments else {}),
        **({"publisher": {"@id": "#publisher"}} if publisher else {}),
    }
    about = {"@id": FILE, "@type": "CreativeWork", "conformsTo": {"@id": CRATE}, "about": {"@id": "./"}}
    licence = {
        "@id": said.licence_url,
        "@type": "CreativeWork",
        "name": said.licence,
        "description": f"The licence {said.licence}",
    }
    graph = [
        about,
        root,
        *parts,
        licence,
        *creators,
        *operator,
        *publisher,
        measurement,
        protocol,
        *settings,
        *instruments,
        software,
        *comments,
    ]
    content = {"@context": [f"{CRATE}/context", {"sha256": "https://schema.org/sha256"}], "@graph": graph}
    return json.dumps(content, indent=1).encode()


def _ids(entities: list[Entity]) -> list[Entity]:
    return [{"@id": one["@id"]} for one in entities]


def _one_or_more(entities: list[Entity]) -> Entity | list[Entity]:
    found = _ids(entities)
    return found[0] if len(found) == 1 else found


def _person(person: Person, otherwise: str) -> Entity:
    found = f"https://orcid.org/{person.orcid}" if person.orcid else otherwise
    return {"@id": found, "@type": "Person", "name": person.name}


def _instrument(role: str, identity: Mapping[str, Any]) -> Entity:
    return {
        "@id": f"#{role}",
        "@type": "IndividualProduct",
        "name": f"{identity.get('manufacturer', '')} {identity.get('model', '')}".strip() or role,
        "description": f"{role}, firmware {identity.get('firmware', 'unknown')}",
        "model": str(identity.get("model", "")),
        "serialNumber": str(identity.get("serial", "")),
    }
