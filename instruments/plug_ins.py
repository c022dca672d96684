"""What installed packages plug in: the entry points of a group, by name."""

import sys
from functools import cache
from importlib.metadata import EntryPoint, entry_points


def plug_ins(group: str) -> dict[str, EntryPoint]:
    """The entry points of `group`, in the order of their names; none is loaded."""
    return _looked_up(group, tuple(sys.path))


def package_of(point: EntryPoint) -> str:
    """The distribution that an entry point comes with; empty if it comes with none."""
    return "" if point.dist is None else point.dist.name


@cache
def _looked_up(group: str, _search_path: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Once for each search path: that reads a file of every package, and a bench has five drivers."""
    return {point.name: point for point in sorted(entry_points(group=group), key=lambda point: point.name)}
