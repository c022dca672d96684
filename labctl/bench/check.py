"""Is every instrument of a bench there and well? Each one is asked, whatever another one says."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from instruments.errors import InstrumentError, LightLost
from instruments.interfaces import Instrument, TunableLaser
from instruments.transcripts import Transcript
from instruments.values import Examination, Identity, Range
from labctl.bench.identity import asked, require_known
from labctl.bench.lock import held
from labctl.bench.opening import Access, opened_one_by_one
from labctl.bench.station import Station

PASSED, NOT_RUN = "passed", "not run"
BY_HAND = "by hand"
"""In the place of an address."""
QUICK_S = 60.0
"""Self-tests that may take longer are left out, unless somebody has asked for them."""
UNKNOWN, UNTOLD = Identity("", "", "", ""), Examination()


@dataclass
class Finding:
    """What is known of one instrument.

    Attributes:
        driver, address: As the station says; `BY_HAND` for what a person sets.
        identity: Who it is.
        examination: Options, what the error queue held, limits of the driver.
        allowed: The limits of the station for what is set here, by the names of `examination`.
        self_test: `PASSED`, `NOT_RUN`, or its error.
        self_test_s: How long that may take.
        emits: Whether a laser says that it does; None of what is no laser, or cannot tell.
        problem: Why it is not well, and what to do; empty if it is.
    """

    driver: str
    address: str
    identity: Identity = UNKNOWN
    examination: Examination = UNTOLD
    allowed: dict[str, Range] = field(default_factory=dict)
    self_test: str = NOT_RUN
    self_test_s: float = 0.0
    emits: bool | None = None
    problem: str = ""

    @property
    def ok(self) -> bool:
        """Whether it is there and well."""
        return not self.problem


def check_bench(
    station: Station,
    transcript: Transcript,
    access: Access = Access(),
    *,
    patience_s: float = QUICK_S,
    begins: Callable[[str, float], None] = lambda _name, _takes_s: None,
) -> dict[str, Finding]:
    """Connect to every instrument in turn, ask who it is and how it is, and let it test itself; in the dark.

    Self-tests that may take longer than `patience_s` are left out; `begins` is told the name and the time (s) of each
    that is run.

    Raises:
        StationError: the station is wrong.
        OutOfRange: a level above its limit.
        BenchInUse: another process has an instrument; nothing was sent to it but the question who it is.
    """
    allowed = {
        "laser": {"laser.power": Range(0.0, station.limits.optical_power, "W")},
        "awg": {"awg.amplitude": Range(0.0, station.limits.rf_amplitude, "Vpp")},
        "scope": {"detector": Range(-station.limits.detector, station.limits.detector, "V")},
        "amplifier": {"amplifier.power": Range(0.0, station.limits.amplified_power, "W")},
    }
    with (
        held(station, "labctl check", access.wire) as hold,
        opened_one_by_one(station, transcript, access) as instruments,
    ):
        findings, by_hand = {}, station.by_hand
        for name, instrument in instruments.items():
            section = station.section_of(name)
            address = BY_HAND if name in by_hand else section.address
            findings[name] = Finding(section.driver, address, allowed=allowed.get(name, {}))
            try:
                if isinstance(instrument, InstrumentError):
                    raise instrument
                findings[name].identity = asked(instrument)
                hold.identified(name, findings[name].identity)  # before a run's errors are taken out of its queue
                require_known(station, name, findings[name].identity)
                _examine(instrument, findings[name])
                _test(name, instrument, findings[name], patience_s, begins)
                _require_no_errors(name, findings[name])
            except InstrumentError as error:
                findings[name].problem = str(error)
    return findings


def _examine(instrument: Instrument, finding: Finding) -> None:
    finding.examination = instrument.examine()
    if isinstance(instrument, TunableLaser) and instrument.switches_itself:
        finding.emits = _emits(instrument)


def _emits(laser: TunableLaser) -> bool:
    try:
        laser.require_emission()
    except LightLost:
        return False
    return True


def _test(
    name: str, instrument: Instrument, finding: Finding, patience_s: float, begins: Callable[[str, float], None]
) -> None:
    finding.self_test_s = instrument.self_test_s
    if instrument.self_test_s > patience_s:
        return
    begins(name, instrument.self_test_s)
    try:
        instrument.self_test()
    except InstrumentError as error:
        finding.self_test = str(error)
        raise
    finding.self_test = PASSED


def _require_no_errors(name: str, finding: Finding) -> None:
    if finding.examination.errors:
        queue = "; ".join(dict.fromkeys(finding.examination.errors))
        raise InstrumentError(
            f"{name}: its error queue held {queue}: it is empty now, repeat the check to see whether they come again"
        )


def as_json(finding: Finding) -> dict[str, Any]:
    """A finding as it is printed for scripts; a bound that there is not is null."""
    limits = {**finding.examination.limits, **finding.allowed}
    return {
        "ok": finding.ok,
        "driver": finding.driver,
        "address": finding.address,
        "identity": " ".join(part for part in vars(finding.identity).values() if part),
        **vars(finding.identity),
        "options": finding.examination.options,
        "self_test": finding.self_test,
        "self_test_s": finding.self_test_s,
        "emits": finding.emits,
        "errors": list(finding.examination.errors),
        "limits": {
            name: {"low": _bound(limit.low), "high": _bound(limit.high), "unit": limit.unit}
            for name, limit in limits.items()
        },
        "problem": finding.problem,
    }


def _bound(value: float) -> float | None:
    return value if math.isfinite(value) else None
