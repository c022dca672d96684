"""The table as data: which setting another client changes when; and how one field of it is carried out and judged."""

import contextlib
import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.bench.station import SIMULATED_STATION, Station, write_addresses
from labctl.commands.main import main as labctl
from tests.faults.matrix import SMALL, WAITS, short_waits
from tests.knobs.interloper import Overheard, VisitedBench, moments
from tests.knobs.lies import BEFORE, LIES, Lie
from tests.knobs.settings import DRIVE, KNOBS, Knob

SHOTS, BURST_SHOTS = 16, 4
ONE_PICTURE = (0, 4)
"""The first image, and the first reference, which shows it again; the simulated noise of further ones is the same."""
RUN = ("run", "image-readout", "--json", "--set", "images=10", "--set", "reference_every=4", "--set", "ports=2,3,4,5")
WINDOW = ("--set", "window=1.6 ns")
TIMEOUT_S = 2.0
PATIENCE_S = 120.0
"""The same where every instrument answers: nobody waits for it, and a busy machine decides nothing."""
NOISE_FACTOR = 2.2
"""How much larger than that of two records of the first picture the difference of a wrong record is at least: brighter
pictures have up to 1.3 times its noise, which scatters by a fifth."""

SOFTWARE, BURST, AVERAGES = "software-timed", "burst", "averages"
MODES: dict[str, tuple[str, ...]] = {
    SOFTWARE: (*RUN, *WINDOW),
    BURST: (*RUN, *WINDOW, "--set", "timing=burst"),
    AVERAGES: (*RUN, *WINDOW, "--set", "averages=4"),
}
RECORDS = {SOFTWARE: SHOTS, BURST: -(-SHOTS // BURST_SHOTS), AVERAGES: SHOTS}
"""Acquisitions of a pass, behind those that find the ranges."""
WHEN: dict[str, tuple[str, ...]] = {
    SOFTWARE: (BEFORE, "ranging", "between records", "between channels", "next pass", "last record"),
    BURST: ("between records", "before the picture", "between channels", "last record"),
    AVERAGES: ("between records", "between channels"),
}
INSIDE_A_RECORD = ("between channels",)
"""Moments at which the light of the record is taken already: what only light depends on need not be tried."""

RIGHT, MENDED, MARKED, ENDED, NAMED, REFUSED = "right", "mended", "marked", "ends", "ends, named", "refused"
WRONG = "WRONG, UNMARKED"


class Case(NamedTuple):
    """One field of the table."""

    cause: Knob | Lie
    mode: str
    when: str

    @property
    def identifier(self) -> str:
        """Its name in test reports and in the document."""
        return f"{self.cause.role}-{self.cause.name}-{self.mode}-{self.when}".replace(" ", "_")


def cases() -> Iterator[Case]:
    """The whole table, in the order of the document."""
    for knob in KNOBS:
        for mode, whens in WHEN.items():
            for when in whens:
                if knob.burst_only and mode != BURST:
                    continue
                if when == BEFORE and (knob.role == "dmd" or DRIVE.encode() in knob.sent):
                    continue  # a DMD that somebody holds is nobody else's; the waveform is not there yet
                if when in INSIDE_A_RECORD and knob.role != "scope":
                    continue
                yield Case(knob, mode, when)
    for lie in LIES:
        for mode in MODES:
            begins = lie.when_burst if mode == BURST else lie.when
            if begins is not None:
                yield Case(lie, mode, begins)


@dataclass(frozen=True)
class Ended:
    """How a run ended, gone on with `resume` if it ended early.

    status: exit status of `run`. told: its error, empty for none. volts, offsets, marked: of every record that was
    kept, (shots, ports, ...). scales: volts a code, (ports,). resumed: whether it had begun, and so went on.
    recovered: how often it went on by itself. overheard: what the run said.
    """

    status: int
    told: str
    volts: NDArray[np.float64]
    offsets: NDArray[np.float64]
    marked: NDArray[np.bool_]
    scales: NDArray[np.float64]
    resumed: bool
    recovered: int
    overheard: Overheard
    visited: bool


def undisturbed(mode: str, folder: Path) -> Ended:
    """A run with nobody else on the bench."""
    return _carried_out(VisitedBench(SMALL), mode, folder, PATIENCE_S)


def carried_out(case: Case, expected: Ended, folder: Path) -> Ended:
    """The same run, disturbed; files go into `folder`."""
    if case.when == BEFORE:
        bench = VisitedBench(SMALL)
        case.cause.befalls(bench)
        bench.visited = True
    else:
        moment = moments(expected.overheard, RECORDS[case.mode])[case.when]
        bench = VisitedBench(SMALL, moment=moment, visit=case.cause.befalls)
    return _carried_out(bench, case.mode, folder, PATIENCE_S if case.cause.answered else TIMEOUT_S)


def outcome(case: Case, ended: Ended, alone: Mapping[str, Ended]) -> str:
    """What became of a run, in the words of the document; `alone` has the undisturbed ones by mode.

    Raises:
        AssertionError: it ended as no run may; the message says how.
    """
    expected = alone[case.mode]
    assert ended.visited, "the moment never came"
    if ended.status:
        assert ended.told, "it ended without a word"
        assert "\n" not in ended.told, f"more than one line: {ended.told}"
    noise = _noise(alone[AVERAGES if case.mode == AVERAGES else SOFTWARE])
    wrong, equal = _wrong(ended, expected, noise), _equal(ended, expected)
    # A record that was measured again has other noise; all others are the undisturbed ones, byte for byte.
    again = bool(ended.recovered) or ended.overheard.arms() != expected.overheard.arms()
    unmarked = ~ended.marked & (wrong if again or ended.resumed or case.cause.harmless else ~equal)
    assert not unmarked.any(), f"{WRONG}: {int(unmarked.sum())} of {unmarked.size} records; told: {ended.told!r}"
    if ended.status:
        if not ended.resumed:
            return REFUSED
        return NAMED if isinstance(case.cause, Knob) and case.cause.word in ended.told.lower() else ENDED
    if ended.marked.any():
        return MARKED
    return MENDED if again else RIGHT


def _carried_out(bench: VisitedBench, mode: str, folder: Path, timeout_s: float) -> Ended:
    station, run = folder / "station.toml", folder / "run"
    sections = {name: {"timeout": f"{timeout_s} s"} for name in ("awg", "dmd", "patch_panel")}
    sections["scope"] = {"timeout": f"{timeout_s} s", "channels": [1, 2]}  # type: ignore[dict-item]
    hasty = Station.model_validate(SIMULATED_STATION.model_dump(exclude_defaults=True) | sections)
    with bench, short_waits(*WAITS, bound_s=timeout_s), pytest.MonkeyPatch.context() as settings:
        settings.setattr("protocols.bursts.LONGEST_BURST", BURST_SHOTS)
        write_addresses(station, {role: found["socket"] for role, found in bench.resources.items()}, hasty)
        status, result = _command(*MODES[mode], "--station", str(station), "--out", str(run))
        resume = ("resume", str(run), "--json", "--station", str(station))
        resumed = bool(status) and run.exists()
        if resumed and _command(*resume)[0]:
            for role in ("scope", "awg"):  # a person puts right what the line has named
                bench.say(role, b"*RST\n*CLS\nHEADer OFF")
            _command(*resume)
    told, recovered = str(result.get("error", "")), int(result.get("recovered", 0))
    return Ended(status, told, *_kept(run), resumed, recovered, bench.overheard, bench.visited)


def _command(*words: str) -> tuple[int, Mapping[str, Any]]:
    """Exit status of a command of labctl and the JSON object that it printed."""
    written = io.StringIO()
    with contextlib.redirect_stdout(written), contextlib.redirect_stderr(io.StringIO()):
        try:
            labctl(words)
        except SystemExit as ended:
            return int(str(ended.code)), json.loads(written.getvalue())
    raise AssertionError("a command ends with its status")


def _kept(run: Path) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Volts, trigger offsets, marks and scales of every record in data.h5; none where there is no run."""
    path = run / "data.h5"
    if run.exists() and not path.exists():
        _command("verify", str(run), "--rebuild", "--json")
    if not path.exists():
        return np.empty((0, 1, 1)), np.empty((0, 1)), np.empty((0, 1), np.bool_), np.ones(1)
    with h5py.File(path) as file:
        codes = file["frames"][()]
        volts = codes * file["scale"][()][:, None] + file["offset"][()][:, None]
        marked = np.zeros(codes.shape[:2], np.bool_)
        shots = file["shots"][()]
        if "suspect" in shots.dtype.names:
            marked |= (shots["suspect"] != 0)[:, None]
        return volts, file["trigger_offset_s"][()], marked, file["scale"][()]


def _equal(ended: Ended, expected: Ended) -> NDArray[np.bool_]:
    """Which records are the undisturbed ones, byte for byte; (shots, ports)."""
    shots = len(ended.volts)
    same = (ended.volts == expected.volts[:shots]).all(axis=2) & (ended.offsets == expected.offsets[:shots])
    return np.asarray(same)


def _wrong(ended: Ended, expected: Ended, noise: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which records differ from the undisturbed ones by more than noise; (shots, ports)."""
    shots = len(ended.volts)
    difference = np.sqrt(((ended.volts - expected.volts[:shots]) ** 2).mean(axis=2))
    coarser = np.maximum(1.0, ended.scales / expected.scales)  # ranges that were found anew may be others
    return np.asarray((difference > NOISE_FACTOR * noise * coarser) | (ended.offsets != expected.offsets[:shots]))


def _noise(expected: Ended) -> NDArray[np.float64]:
    """Rms of the difference of two records of one picture, (ports,)."""
    one, other = expected.volts[list(ONE_PICTURE)]
    return np.asarray(np.sqrt(((one - other) ** 2).mean(axis=1)))
