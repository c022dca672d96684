"""What the environments are made from: every package is pinned with its hashes, torch alone by version."""

import re

import pytest

from tests.checkout import ROOT

LOCKS = sorted(path.name for path in ROOT.glob("requirements*.lock"))
PINNED = re.compile(r"^([A-Za-z0-9._-]+)==(\S+)(.*)", re.MULTILINE)


def pins(lock: str) -> dict[str, str]:
    """Version of each package."""
    return {name.lower(): version for name, version, _ in PINNED.findall((ROOT / lock).read_text("utf-8"))}


@pytest.mark.parametrize("lock", LOCKS)
def test_every_package_has_hashes(lock: str) -> None:
    text = (ROOT / lock).read_text("utf-8")
    entries = re.split(r"^(?=\S)", "\n".join(line for line in text.splitlines() if "#" not in line), flags=re.MULTILINE)
    named = [entry for entry in entries if entry.strip()]
    assert named
    assert [entry for entry in named if not re.match(r"[\w.-]+==\S+ \\\n\s+--hash=sha256:[0-9a-f]{64}", entry)] == []


@pytest.mark.parametrize("lock", [lock for lock in LOCKS if lock != "requirements-interop.lock"])
def test_what_goes_into_one_environment_is_one_version(lock: str) -> None:
    whole = pins("requirements-docs.lock")
    assert {name: version for name, version in pins(lock).items() if whole.get(name, version) != version} == {}


def test_the_installer_and_the_libraries_of_real_instruments_are_in_a_lock() -> None:
    assert {"pip", "setuptools"} <= pins("requirements.lock").keys() & pins("requirements-interop.lock").keys()
    assert {"alp4lib", "hidapi", "pyserial", "pyusb"} <= pins("requirements-hardware.lock").keys()


def test_torch_alone_has_no_hash() -> None:
    assert pins("requirements-torch.txt").keys() == {"torch"}
    assert not [lock for lock in LOCKS if "torch" in pins(lock)]
