"""`make fuzz MINUTES=60`: new inputs until the time is up; says how many there were, exits 1 if anything was found.

Every round gives each model a few hundred examples of each property, each driver as many changed answers and each kind
of file as many changed files, with a seed that is printed with a finding. `--only WORD` keeps those whose name holds
that word.
"""

import argparse
import faulthandler
import logging
import resource
import secrets
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from functools import partial

from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from sim_backends.virtual import VirtualInstrument
from tests.fuzz.answers import LIVES, answers_are_taken_or_refused
from tests.fuzz.files import SUBJECTS, taken_or_refused
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
    parser.add_argument("--only", default="")
    asked = parser.parse_args()
    if not any(_properties(asked.only)):
        parser.error(f"no model, driver or kind of file has {asked.only!r} in its name")
    ends = time.monotonic() + 60 * asked.minutes
    faulthandler.enable()
    logging.disable(logging.WARNING)  # of each fault that strikes
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    findings = rounds = 0
    while time.monotonic() < ends:
        rounds += 1
        for name, property_ in _properties(asked.only):
            if time.monotonic() < ends:
                findings += not _holds(property_, secrets.randbits(64), name)
        _say(f"round {rounds}: {COUNTED['inputs']} inputs, {COUNTED['messages']} messages, {findings} findings")
    for kind in filter(COUNTED.get, SUBJECTS):
        _say(f"{kind}: {COUNTED[kind]} files")
    for role in filter(COUNTED.get, map("answers of {}".format, LIVES)):
        _say(f"{role}: {COUNTED[role]} conversations")
    _say(f"fuzz: {COUNTED['inputs']} inputs, {COUNTED['messages']} messages, {findings} findings")
    return 1 if findings else 0


def _properties(only: str) -> Iterator[tuple[str, Callable[[st.DataObject], None]]]:
    for name, model in MODELS.items():
        for holds in PROPERTIES.values():
            if only in name:
                yield f"{holds.__name__}, {name}", partial(_of_a_model, holds, model)
    for role in LIVES:
        if only in f"answers of {role}":
            yield f"answers_are_taken_or_refused, {role}", partial(answers_are_taken_or_refused, role=role)
    for kind in SUBJECTS:
        if only in kind:
            yield f"taken_or_refused, {kind}", partial(taken_or_refused, kind=kind)


def _of_a_model(holds: Property, model: type[VirtualInstrument], data: st.DataObject) -> None:
    holds(data, model)


def _holds(property_: Callable[[st.DataObject], None], number: int, name: str) -> bool:
    @seed(number)
    @settings(max_examples=EXAMPLES, deadline=SLOWEST_MS, database=None, suppress_health_check=list(HealthCheck))
    @given(data=st.data())
    def examples(data: st.DataObject) -> None:
        property_(data)

    faulthandler.dump_traceback_later(STUCK_S, repeat=True)
    try:
        examples()
    except Exception:  # noqa: BLE001 - whatever an instrument or a parser raises is what is looked for
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
