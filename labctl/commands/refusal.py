"""A bench that somebody else has is refused before the command is loaded, which takes many times longer."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from instruments.toml_files import TomlError, read_toml

OPENING = frozenset({"align", "check", "live", "reproduce", "run", "sweep"})
"""The commands that open the bench of their option `--station`."""
ONLY_LOOKING = frozenset({"--dry-run", "--help"})
SIMULATED = "simulated"
"""As `instruments.sections` has it, which takes longer to load than all of this."""


def refuse_bench_in_use(words: Sequence[str]) -> None:
    """Whether another process has an instrument of the bench that `words`, a command and its options, would open.

    What is wrong with the words or the station file is left to the command to say.

    Raises:
        BenchInUse: another process has one.
    """
    if not words or words[0] not in OPENING or not ONLY_LOOKING.isdisjoint(words):
        return
    if addresses := dict(_addresses(_station(words))):
        from labctl.bench.holder import refuse_in_use
        from labctl.bench.recording.wire import Wire

        if Wire.of_this_process().replay is None:
            refuse_in_use(addresses.items())


def _station(words: Sequence[str]) -> Mapping[str, object]:
    named = [word.partition("=")[2] for word in words if word.startswith("--station=")]
    named += [word for option, word in pairwise(words) if option == "--station"]
    try:
        return read_toml(Path(named[0])) if named else {}
    except (OSError, TomlError):
        return {}


def _addresses(station: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    for name, section in station.items():
        match section:
            case {"address": str(address)} if address != SIMULATED:
                yield name, address
