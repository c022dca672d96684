"""DataCite metadata as JSON, as a repository takes them to register a DOI. Source: schema.datacite.org, kernel 4.5."""

import json
from collections.abc import Mapping
from datetime import date
from typing import Any

from labctl.errors import UsageError
from labctl.runs.publication.declaration import Declaration, Person
from labctl.runs.publication.subject import Subject

FILE = "datacite.json"
SCHEMA = "http://datacite.org/schema/kernel-4"


def encode(subject: Subject, said: Declaration, files: Mapping[str, tuple[int, str]], published: date) -> bytes:
    """The bytes of `FILE`; `files` have size and SHA-256 by their place.

    Raises:
        UsageError: nobody said who publishes it.
    """
    if not said.publisher:
        raise UsageError('--publisher: DataCite needs one, and only you can say it: add --publisher "Our university"')
    spdx = not said.licence.startswith("https://")
    scheme = {
        "rightsIdentifier": said.licence,
        "rightsIdentifierScheme": "SPDX",
        "schemeUri": "https://spdx.org/licenses/",
    }
    words = [*(fault.partition(":")[0].lower() for fault in subject.faults), subject.protocol[0], *subject.notes.tags]
    notes = [
        {"description": f"{one.time} {one.by}: {one.text}", "descriptionType": "Other"} for one in subject.notes.notes
    ]
    used = ", ".join(
        f"{role} {one.get('manufacturer', '')} {one.get('model', '')} (serial {one.get('serial', '')})"
        for role, one in subject.instruments
    )
    operator = subject.notes.operator
    content: dict[str, Any] = {
        "schemaVersion": SCHEMA,
        "creators": [_person(one) for one in said.creators],
        "titles": [{"title": f"{subject.marks}{said.title}"}],
        "publisher": {"name": said.publisher},
        "publicationYear": str(published.year),
        "types": {
            "resourceTypeGeneral": "Dataset",
            "resourceType": f"{subject.kind}, {subject.protocol[0]}",
        },
        "subjects": [{"subject": word} for word in words],
        "dates": [{"date": subject.started, "dateType": "Created"}] if subject.started else [],
        "descriptions": [
            {"description": subject.description(said.description), "descriptionType": "Abstract"},
            {
                "description": f"Software: labctl {subject.software}. Instruments: {used}.",
                "descriptionType": "TechnicalInfo",
            },
            *notes,
        ],
        "rightsList": [{"rights": said.licence, "rightsUri": said.licence_url} | (scheme if spdx else {})],
        "sizes": [f"{len(files)} files", f"{sum(size for size, _ in files.values())} bytes"],
        "formats": ["application/x-hdf5"],
    }
    if operator:
        content["contributors"] = [{"name": operator, "nameType": "Personal", "contributorType": "DataCollector"}]
    return json.dumps(content, indent=1).encode()


def _person(person: Person) -> dict[str, Any]:
    found: dict[str, Any] = {"name": person.name, "nameType": "Personal"}
    if person.orcid:
        address = f"https://orcid.org/{person.orcid}"
        found["nameIdentifiers"] = [
            {"nameIdentifier": address, "nameIdentifierScheme": "ORCID", "schemeUri": "https://orcid.org"}
        ]
    return found
