"""`python -m tests.truth`: both Tektronix twins against the manufacturer's descriptions of their families.

It runs in the environment of `make interop`. Exit 1 for a difference that `differences.toml` does not explain, and for
an explanation of what does not differ.
"""

import sys

from tests.truth.comparison import Comparison, compare
from tests.truth.descriptions import FAMILIES, version
from tests.truth.documented import rows
from tests.truth.served import served


def judged(comparisons: list[Comparison]) -> tuple[list[str], list[str]]:
    """Differences that nothing explains, and explanations of what does not differ."""
    known, differences = rows(), [difference for found in comparisons for difference in found.differences]
    undocumented = [str(one) for one in differences if not any(row.explains(one) for row in known)]
    found = {(one.role, one.header, one.what) for one in differences}
    stale = [
        f"{row.role} {row.header}: {what}"
        for row in known
        for what in row.what
        if (row.role, row.header, what) not in found
    ]
    return undocumented, stale


def main() -> int:
    """Compare, print, judge."""
    with served() as resources:
        comparisons = [compare(role, resources[role]["socket"]) for role in FAMILIES]
    undocumented, stale = judged(comparisons)
    lines = [_counts(found) for found in comparisons]
    lines += [
        f"documented: {row.role} {row.header}: {', '.join(row.what)}. {row.reason} ({row.source})" for row in rows()
    ]
    lines += [f"UNDOCUMENTED: {text}" for text in undocumented]
    lines += [f"NO LONGER SO: {text}" for text in stale]
    lines.append(f"{sum(len(row.what) for row in rows())} differences documented, {len(undocumented)} undocumented")
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if undocumented or stale else 0


def _counts(found: Comparison) -> str:
    differing = len({difference.header for difference in found.differences})
    return (
        f"{found.role} ({FAMILIES[found.role]}, tm_devices {version()}): {found.compared} headers compared, "
        f"{len(found.simulated)} simulated, {len(found.not_simulated)} known and not simulated, {differing} differ "
        f"in {len(found.differences)} of {found.checks} checks"
    )


if __name__ == "__main__":
    sys.exit(main())
