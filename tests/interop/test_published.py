"""Published runs as others read and check them: ro-crate-py, the RO-Crate validator of CRS4, DataCite's own schema."""

import io
import json
import os
import subprocess
import urllib.request
import urllib.response
from collections.abc import Iterator
from email.message import Message
from pathlib import Path
from typing import Any

import pytest

schema45 = pytest.importorskip("datacite.schema45", reason="datacite is absent: `make interop`")
rocrate = pytest.importorskip("rocrate.rocrate", reason="ro-crate-py is absent: `make interop`")
models = pytest.importorskip("rocrate_validator.models", reason="roc-validator is absent: `make interop`")
services = pytest.importorskip("rocrate_validator.services", reason="roc-validator is absent: `make interop`")

LABCTL = os.environ.get("LABCTL", "labctl")
CONTEXT = "https://w3id.org/ro/crate/1.1/context"
"""What the validator fetches: its shapes are given the vocabulary that ro-crate-py brings along, so that no network is
needed; the two checks that ask for it by another way say that they cannot reach it."""


class _Vocabulary(urllib.request.HTTPSHandler):
    """Answers for the address of the vocabulary, whoever serves it."""

    def https_open(self, req: urllib.request.Request) -> Any:
        assert req.full_url == CONTEXT
        content = (Path(rocrate.__file__).parent / "data" / "ro-crate.jsonld").read_bytes()
        headers = Message()
        headers["Content-Type"] = "application/ld+json"
        answer: Any = urllib.response.addinfourl(io.BytesIO(content), headers, CONTEXT, 200)
        answer.msg = "OK"
        return answer


@pytest.fixture
def vocabulary() -> Iterator[None]:
    urllib.request.install_opener(urllib.request.build_opener(_Vocabulary))
    yield
    urllib.request.install_opener(urllib.request.build_opener())


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the simulated bench, as a crate and with DataCite metadata."""
    folder = tmp_path_factory.mktemp("published")
    said = ["--title", "Digits", "--creator", "Ada Lovelace <0000-0002-1825-0097>", "--creator", "Grace Hopper"]
    said += ["--licence", "CC-BY-4.0", "--publisher", "A university"]
    for words in (
        ["run", "image-readout", "--set", "images=10", "--set", "window=0.4 ns", "--out", "run"],
        ["note", "run", "fibre touched", "--tag", "good", "--operator", "Ada"],
        ["publish", "run", "--as", "ro-crate", "--out", "crate", *said],
        ["publish", "run", "--as", "datacite", "--out", "datacite", *said],
    ):
        subprocess.run([LABCTL, *words], cwd=folder, check=True, capture_output=True)
    return folder


def test_the_crate_is_read_by_ro_crate_py(published: Path) -> None:
    crate = rocrate.ROCrate(published / "crate")
    assert crate.name == "[SIMULATED] Digits"
    assert {one["name"] for one in crate.creator} == {"Ada Lovelace", "Grace Hopper"}
    assert {one.id for one in crate.data_entities} >= {"data.h5", "manifest.json", "shards/000000.h5"}


@pytest.mark.usefixtures("vocabulary")
def test_the_crate_meets_what_ro_crate_requires(published: Path) -> None:
    settings = services.ValidationSettings(
        rocrate_uri=str(published / "crate"),
        profile_identifier="ro-crate-1.1",
        requirement_severity=models.Severity.REQUIRED,
        no_cache=True,
    )
    result = services.validate(settings)
    assert len(result.executed_checks) > 30
    issues = [str(one.message) for one in result.get_issues()]
    assert [one for one in issues if "/ro/crate/1.1/context" not in one] == []


def test_the_metadata_are_those_of_datacite(published: Path) -> None:
    found = json.loads((published / "datacite" / "datacite.json").read_text("utf-8"))
    assert [one.message for one in schema45.validator.iter_errors(found)] == []
    assert found["titles"] == [{"title": "[SIMULATED] Digits"}]
