"""`make fuzz MINUTES=60`: new inputs until the time is up; says how many there were, exits 1 if anything was found.

Every round gives each model a few hundred examples of each property, with a seed that is printed with a finding.
"""

import argparse
import faulthandler
import resource
import secrets
import sys
import time
import traceback

from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from sim_backends.virtual import VirtualInstrument
from tests.fuzz.inputs import MODELS
from tests.fuzz.link import COUNTED
from tests.fuzz.properties import PROPERTIES, Property

EXAMPLES = 200
SLOWEST_MS = 30_000  # an input that takes longer is a finding
STUCK_S = 300.0  # some hundred inputs that take longer: where they are is printed
MEMORY = 6 << 30  # bytes of address space: an input that asks for more is a finding, not the end of the machine


def main() -> int:
    """Fuzz for the minutes asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    ends = time.monotonic() + 60 * parser.parse_args().minutes
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    findings = rounds = 0
    while time.monotonic() < ends:
        rounds += 1
        for name, model in MODELS.items():
            for holds in PROPERTIES.values():
                if time.monotonic() < ends:
                    findings += not _holds(holds, model, secrets.randbits(64), f"{holds.__name__}, {name}")
        _say(f"round {rounds}: {COUNTED['inputs']} inputs, {COUNTED['messages']} messages, {findings} findings")
    _say(f"fuzz: {COUNTED['inputs']} inputs, {COUNTED['messages']} messages, {findings} findings")
    return 1 if findings else 0


def _holds(holds: Property, model: type[VirtualInstrument], number: int, name: str) -> bool:
    @seed(number)
    @settings(max_examples=EXAMPLES, deadline=SLOWEST_MS, database=None, suppress_health_check=list(HealthCheck))
    @given(data=st.data())
    def examples(data: st.DataObject) -> None:
        holds(data, model)

    faulthandler.dump_traceback_later(STUCK_S, repeat=True)
    try:
        examples()
    except Exception:  # noqa: BLE001 - whatever an instrument raises is what is looked for
        _say(f"FINDING: {name}, seed {number}\n{traceback.format_exc()}")
        return False
    finally:
        faulthandler.cancel_dump_traceback_later()
    return True


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
