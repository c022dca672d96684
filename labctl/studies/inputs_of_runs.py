"""Where what a run shows comes from: images of one source and place are the same image, however their set is called."""

from collections.abc import Mapping
from typing import Any

from labctl.datasets import catalogue
from labctl.runs.format.manifest import inputs_source


def source_of(manifest: Mapping[str, Any]) -> str | None:
    """What the inputs of a run are known by, together with their places; None where nobody says."""
    found = inputs_source(manifest)
    return None if found is None else identity_of(found)


def identical_images(manifest: Mapping[str, Any]) -> int:
    """How many images of a run are identical to another one of it, as far as its manifest says."""
    found = manifest.get("identical_images")
    return found if isinstance(found, int) else 0


def identity_of(name: str) -> str:
    """What the images of a set of that name are known by; of a set that has no card, the name."""
    return next((card.identity for card in catalogue() if card.name == name), name)
