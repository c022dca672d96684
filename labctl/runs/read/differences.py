"""How two runs, or what one was begun with and what is there now, differ in their settings."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

SAME = 1e-6
"""Numbers that an instrument reports again may differ by so much of themselves."""
ROUNDING = 1e-12
"""Of a number that is compared as it is: 1 pm at 1550 nm is a difference."""
FOLLOWS = (
    "started",
    "plan_sha256",
    "inputs_sha256",
    "images_sha256",
    "identical_images",
    "protocol.digest",
    "format_version",
)
"""Of a manifest: what is another in every run, or what follows from the settings that are listed."""


@dataclass(frozen=True)
class Difference:
    """A setting that is not what it was; None for one that is not there.

    When two runs are compared, `then` is of the first and `now` of the second.
    """

    setting: str
    then: object
    now: object


def differences(
    then: Mapping[str, Any], now: Mapping[str, Any], *, of: str = "", ignored: tuple[str, ...] = (), same: float = SAME
) -> tuple[Difference, ...]:
    """Every setting of two nested mappings that differs, by name, such as `station.sim.twin_seed`.

    Args:
        then: One mapping; lists are compared as a whole.
        now: The other.
        of: What the settings are of: a word before each name.
        ignored: Patterns (as of file names) of the settings that do not count.
        same: By so much of themselves numbers may differ.
    """
    before, after = _flat(then), _flat(now)
    return tuple(
        Difference(f"{of} {name}".lstrip(), before.get(name), after.get(name))
        for name in sorted(before.keys() | after.keys())
        if not _same(before.get(name), after.get(name), same)
        and not any(fnmatchcase(name, pattern) for pattern in ignored)
    )


def settings_that_differ(
    one: Mapping[str, Any], other: Mapping[str, Any], sent_anew: Callable[[Mapping[str, Any]], Iterable[str]]
) -> tuple[Difference, ...]:
    """What differs between the manifests of two runs: protocol, station, instruments, versions, seeds and the rest.

    Of settings that are `sent_anew` by the run of a manifest, as patterns, it says what an earlier command had left.
    """
    return differences(one, other, ignored=(*FOLLOWS, *sent_anew(one), *sent_anew(other)), same=ROUNDING)


def _same(then: object, now: object, by: float) -> bool:
    if isinstance(then, float) or isinstance(now, float):
        if not isinstance(then, int | float) or not isinstance(now, int | float):
            return False
        return abs(then - now) <= by * max(abs(then), abs(now))
    return then == now


def _flat(values: Mapping[str, Any]) -> dict[str, object]:
    flat: dict[str, object] = {}
    left: list[tuple[str, Mapping[str, Any]]] = [("", values)]
    while left:
        prefix, found = left.pop()
        for key, value in found.items():
            if isinstance(value, dict):
                left.append((f"{prefix}{key}.", value))
            else:
                flat[f"{prefix}{key}"] = value
    return flat
