"""The fault matrix as data: which fault befalls which instrument when; and how one case is carried out and judged."""

import contextlib
import io
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from instruments.safe_state import MAY_EMIT
from instruments.table_amplifier import SIMULATED_TABLE as AMPLIFIER_TABLE
from instruments.table_attenuator import SIMULATED_TABLE as ATTENUATOR_TABLE
from instruments.toml_files import read_toml
from labctl.bench.station import SIMULATED_STATION, Station, write_addresses
from labctl.commands.main import main as labctl
from labctl.runs.read.run import open_run
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import (
    AWG,
    BURST,
    DMD,
    FRAMES,
    HISLIP,
    LASER,
    QUEUE,
    SCOPE,
    START,
    TRACE,
    UPLOAD,
    VXI11,
    WIRE,
    Fault,
    Moment,
)
from sim_backends.optics.mirrors import SIDE
from sim_backends.parameters import Parameters
from sim_backends.virtual.amplifier.instrument import VirtualAmplifier
from sim_backends.virtual.attenuator.instrument import VirtualAttenuator
from sim_backends.virtual.dpo72504dx.instrument import VirtualDpo72504dx
from sim_backends.virtual.pm100.instrument import VirtualPm100
from sim_backends.virtual.tlg220.instrument import default_table
from sim_backends.world.world import World

SMALL = Parameters(chip_modes=50)
RUN = ("run", "image-readout", "--json", "--set", "images=4", "--set", "ports=6", "--set", "window=0.4 ns")
"""Port 6 of this bench has light that one pair of probes shows: more would move the moments, which are counts."""
TIMEOUT_S = 0.4
PATIENCE_S = 120.0
"""The same of instruments that answer: nobody waits so long, and a busy machine decides nothing."""
WAITS = {
    "awg": ("instruments.tektronix_awg70002a.SLOW_S", "instruments.tektronix_awg70002a.Awg70002a.self_test_s"),
    "scope": tuple(
        f"instruments.tektronix_dpo72504dx.{bound}"
        for bound in ("SELF_TEST_S", "TRIGGER_WAIT_S", "BURST_WAIT_S", "STALLED_S")
    ),
}
"""Bounds of waits that no station file sets, by the instrument that is waited for."""

NO_HARM, RECOVERED, CLIPPED = "no harm", "goes on", "clipped"
ENDED, UNCONFIRMED, LEFT = "ends", "ends, unconfirmed", "ends, left as it was"
TRANSPORTS = {"hislip": "HiSLIP", "vxi11": "VXI-11"}
PHASES = ("connecting", "preparing", "acquiring", "finishing")
WITHOUT_QUEUE = ("dmd",)
ANSWERS_FIRST = ("dmd",)
"""Instruments that must answer before they can be made safe; the others are told blindly."""
MOMENTS: dict[str, dict[str, Moment]] = {
    "laser": {
        "connecting": Moment("*IDN?"),
        "preparing": Moment("WAVELENGTH?"),
        "acquiring": Moment("SETTLED?", 4),
        "finishing": Moment("ERROR?", 8),
    },
    "awg": {
        "connecting": Moment("*IDN?"),
        "preparing": Moment("CLOCk:SRATe?"),
        "acquiring": Moment("AWGControl:RSTate?"),
        "finishing": Moment("*OPC?", 4),
    },
    "dmd": {
        "connecting": Moment("ALP:DEVALLOC"),
        "preparing": Moment("ALP:DEVINQUIRE", 5),
        "acquiring": Moment("ALP:SEQPUT", 11),
        "finishing": Moment("ALP:SEQPUT", 15),
    },
    "scope": {
        "connecting": Moment("*IDN?"),
        "preparing": Moment("HORizontal:MODE:RECOrdlength?"),
        "acquiring": Moment("CURVe?", 11),
        "finishing": Moment("*ESR?", 8),
    },
    "patch_panel": {
        "connecting": Moment("*IDN?"),
        "preparing": Moment("ROUTe:CLOSe?"),
        "acquiring": Moment("ROUTe:CLOSe?", 2),
    },
    "power_meter": {
        "connecting": Moment("*IDN?"),
        "preparing": Moment("SENSe:CORRection:COLLect:ZERO:MAGNitude?"),
        "acquiring": Moment("MEASure:POWer?", 3),
        "finishing": Moment("MEASure:POWer?", 8),
    },
    "amplifier": {
        "connecting": Moment("*IDN?"),
        "preparing": Moment("POWer:LEVel?"),
        "acquiring": Moment("POWer:OUTPut?", 3),
        "finishing": Moment("OUTPut?", 14),
    },
    "attenuator": {
        "connecting": Moment("*IDN?"),
        "preparing": Moment("INPut:ATTenuation?"),
        "acquiring": Moment("INPut:ATTenuation?", 4),
        "finishing": Moment("OUTPut?", 14),
    },
}
"""The reply that a fault on the wire strikes; nothing is said to the patch panel at the end."""

BEHIND_THE_LASER = {"power_meter": VirtualPm100, "amplifier": VirtualAmplifier, "attenuator": VirtualAttenuator}
"""Instruments that a bench need not have: all of them, where a fault befalls one."""
BEHIND: dict[str, dict[str, object]] = {
    "power_meter": {"driver": "thorlabs-pm100", "tap": 0.01},
    "amplifier": {"driver": "table-amplifier", "power": "100 mW"},
    "attenuator": {"driver": "table-attenuator", "attenuation_db": 6.0},
}
"""Their light takes a range that is not the finest: in one that is tried twice, noise of repeated frames differs."""
TABLES = {"amplifier": AMPLIFIER_TABLE, "attenuator": ATTENUATOR_TABLE}

SPECIAL: tuple[tuple[str, str, Mapping[str, Fault], Moment, tuple[str, ...]], ...] = (
    *((role, "connecting", START, Moment("", 0), ()) for role in MOMENTS),
    ("laser", "preparing", LASER, Moment("SETTLED?"), ()),
    ("laser", "acquiring", LASER, Moment("SETTLED?", 4), ()),
    ("awg", "acquiring", UPLOAD, Moment("WLISt:WAVeform:DATA"), ()),
    ("awg", "acquiring", AWG, Moment("AWGControl:ARSettings"), ()),
    ("dmd", "connecting", DMD, Moment("ALP:SEQALLOC"), ()),
    ("dmd", "preparing", DMD, Moment("ALP:DEVINQUIRE", 5), ()),
    ("dmd", "acquiring", DMD, Moment("ALP:SEQPUT", 11), ()),
    ("dmd", "acquiring", UPLOAD, Moment("ALP:SEQPUT", 10), ()),
    ("dmd", "finishing", DMD, Moment("ALP:SEQPUT", 15), ()),
    ("scope", "acquiring", TRACE, Moment("CURVe?", 11), ()),
    ("scope", "acquiring", SCOPE, Moment("ACQuire:STATE", 12), ()),
    ("scope", "acquiring", BURST, Moment("HORizontal:FASTframe:COUNt"), ("--set", "timing=burst")),
)
"""What strikes elsewhere, or one instrument only: role, phase, faults, when they strike, how the run is asked."""

FRAMED: dict[str, Mapping[str, Fault]] = {"hislip": WIRE | FRAMES | HISLIP, "vxi11": WIRE | FRAMES | VXI11}
"""What strikes an instrument at its other addresses: the faults that live in the transport."""
FRAMED_MOMENTS: tuple[tuple[str, str, Mapping[str, Fault], Moment], ...] = (
    ("awg", "connecting", START, Moment("", 0)),
    ("awg", "acquiring", UPLOAD, Moment("WLISt:WAVeform:DATA")),
    ("scope", "connecting", START, Moment("", 0)),
    ("scope", "acquiring", TRACE, Moment("CURVe?", 11)),
)
FRAMED_PHASES = ("preparing", "acquiring")

SAFE: dict[str, Callable[[FaultyBench], bool]] = {
    "laser": lambda bench: bench.world._emission is None,
    "awg": lambda bench: bench.world._playback is None,
    "dmd": lambda bench: np.array_equal(bench.world._pictures.latched(bench.world.clock.now), _blank(bench.world)),
    "scope": lambda bench: not _scope(bench)._running,
    "amplifier": lambda bench: not _is_on(bench, "amplifier"),
    "attenuator": lambda bench: not _is_on(bench, "attenuator"),
}
"""The safe state, in the simulated world."""


Way = tuple[tuple[str, ...], bool]


class Case(NamedTuple):
    """One field of the matrix."""

    role: str
    phase: str
    name: str
    fault: Fault
    moment: Moment
    options: tuple[str, ...]
    transport: str = "socket"

    @property
    def place(self) -> str:
        """The instrument, and the transport unless it is the raw socket."""
        return self.role if self.transport == "socket" else f"{self.role} over {TRANSPORTS[self.transport]}"

    @property
    def way(self) -> Way:
        """How the run is asked, and whether there is more behind the laser: what a run without a fault depends on."""
        return self.options, self.role in BEHIND

    @property
    def common(self) -> bool:
        """Whether this may befall every instrument."""
        return self.name in WIRE | QUEUE

    @property
    def identifier(self) -> str:
        """Its name in test reports and in the document."""
        return f"{self.place}-{self.phase}-{self.name}".replace(" ", "_")


def cases() -> Iterator[Case]:
    """The whole matrix, in the order of the document."""
    for role, moments in MOMENTS.items():
        common = WIRE if role in WITHOUT_QUEUE else WIRE | QUEUE
        for name, fault in common.items():
            for phase, moment in moments.items():
                yield Case(role, phase, name, fault, moment, ())
    for role, phase, faults, moment, options in SPECIAL:
        for name, fault in faults.items():
            yield Case(role, phase, name, fault, moment, options)
    for transport, framed in FRAMED.items():
        for role in ("awg", "scope"):
            for name, fault in framed.items():
                for phase in FRAMED_PHASES:
                    yield Case(role, phase, name, fault, MOMENTS[role][phase], (), transport)
        for role, phase, faults, moment in FRAMED_MOMENTS:
            for name, fault in faults.items():
                yield Case(role, phase, name, fault, moment, (), transport)


@dataclass(frozen=True)
class Ended:
    """How a run ended: exit status, the JSON object, what stood on standard error, and the state of the world.

    frames: what was kept, (shots, ports, samples). lit: the instruments that are not in the safe state. struck: whether
    the moment of the fault came.
    """

    status: int
    result: dict[str, Any]
    told: str
    frames: NDArray[np.int8]
    lit: tuple[str, ...]
    struck: bool


@contextlib.contextmanager
def short_waits(*roles: str, bound_s: float = TIMEOUT_S) -> Iterator[None]:
    """Inside the block waits for these instruments that no station sets are short, and attempts to go on are fewer,
    without a pause.
    """
    with pytest.MonkeyPatch.context() as settings:
        for role, names in WAITS.items():
            for name in names:
                settings.setattr(name, bound_s if role in roles else PATIENCE_S)
        settings.setattr("labctl.engine.recovery.PAUSE_S", 0.0)
        settings.setattr("labctl.engine.recovery.ATTEMPTS", 2)
        yield


def carried_out(case: Case, folder: Path, timeout_s: float = TIMEOUT_S) -> Ended:
    """Run a small acquisition on a bench with this fault; files go into `folder`.

    `timeout_s` bounds waits for the instrument that the fault befalls.
    """
    table = default_table()
    table["transport"]["timeout_s"] = _patience_s(case, "laser", timeout_s)
    table["commands"]["is_settled"] |= {"timeout_s": _patience_s(case, "laser", timeout_s), "poll_s": 0.01}
    written, errors = io.StringIO(), io.StringIO()
    bench = FaultyBench(
        [Befalling(case.role, case.fault, case.moment)],
        SMALL,
        noise="by-state",
        laser_table=table,
        plugged_in=BEHIND_THE_LASER if case.role in BEHIND else {},
    )
    waits = short_waits(case.role, bound_s=timeout_s)
    with bench, waits, contextlib.redirect_stdout(written), contextlib.redirect_stderr(errors):
        try:
            labctl(
                (
                    *RUN,
                    *case.options,
                    "--station",
                    str(_station(bench, case, table, folder, timeout_s)),
                    "--out",
                    str(folder / "run"),
                )
            )
        except SystemExit as ended:
            status = int(str(ended.code))
    # The loop has ended: what was sent has been executed.
    lit = tuple(name for name, is_safe in SAFE.items() if not is_safe(bench))
    return Ended(status, json.loads(written.getvalue()), errors.getvalue(), _kept(folder / "run"), lit, bench.struck)


def _patience_s(case: Case, role: str, timeout_s: float) -> float:
    return timeout_s if role == case.role else PATIENCE_S


def undisturbed(folder: Path, case: Case) -> Ended:
    """The same run without a fault."""
    nothing = case._replace(fault=Fault("nothing"), moment=Moment("*IDN?"), transport="socket")
    return carried_out(nothing, folder, PATIENCE_S)


def outcome(case: Case, ended: Ended, expected: Ended) -> str:
    """What became of a run, in the words of the document; `expected` is the same run without a fault.

    Raises:
        AssertionError: it ended as no run may; the message says how.
    """
    assert ended.struck, "the moment of the fault never came"
    assert "Traceback" not in ended.told, ended.told
    if ended.status == 0:
        assert not ended.lit, f"the run succeeded, and {ended.lit} is not in the safe state"
        assert ended.result["complete"], "the run succeeded, and shots are missing"
        if ended.result["frames_sha256"] != expected.result["frames_sha256"]:
            assert ended.result["clipped"], "the run succeeded with other frames, and nobody was told"
            return CLIPPED
        return RECOVERED if ended.result["recovered"] else NO_HARM
    assert ended.status == 1, f"exit status {ended.status}"
    error = str(ended.result["error"])
    assert case.role in error, f"the instrument is not named: {error}"
    assert "\n" not in error, f"more than one line: {error}"
    notes = " ".join(map(str, ended.result.get("notes", ())))
    unreachable = case.fault.refuses or (case.role in ANSWERS_FIRST and case.fault.lasting)
    excused = {case.role} if unreachable else set()
    assert set(ended.lit) <= excused, f"{ended.lit} is not in the safe state: {error} {notes}"
    unconfirmed = "the safe state is not confirmed" in error + notes
    assert unconfirmed or not ended.lit, f"{ended.lit} is not in the safe state, and nobody was told: {error} {notes}"
    assert all(told in error + notes for role, told in MAY_EMIT.items() if role in ended.lit)
    assert np.array_equal(ended.frames, expected.frames[: len(ended.frames)]), "frames were kept that are wrong"
    if ended.lit:
        return LEFT
    return UNCONFIRMED if unconfirmed else ENDED


def _kept(run: Path) -> NDArray[np.int8]:
    """The frames of a run as far as they go; none if it never began."""
    if not run.exists():
        return np.empty((0, 1, 10), np.int8)
    with open_run(run) as stored:
        return np.asarray(stored.frames[: stored.done[0]])


def _station(bench: FaultyBench, case: Case, table: Mapping[str, object], folder: Path, timeout_s: float) -> Path:
    """A station file of `bench` with short timeouts."""
    commands, station = folder / "laser.toml", folder / "station.toml"
    commands.write_text(_toml(table))
    sections: dict[str, dict[str, object]] = {
        name: {"timeout": f"{_patience_s(case, name, timeout_s)} s"} for name in ("awg", "scope", "dmd", "patch_panel")
    }
    sections["laser"] = {"commands": str(commands)}
    if case.role in BEHIND:
        sections |= BEHIND
        sections["power_meter"] = sections["power_meter"] | {"timeout": _patience_s(case, "power_meter", timeout_s)}
        for role, file in TABLES.items():
            own = folder / f"{role}.toml"
            transport = {"timeout_s": _patience_s(case, role, timeout_s)}
            own.write_text(_toml(read_toml(file) | {"transport": transport}))
            sections[role] = sections[role] | {"commands": str(own)}
    hasty = Station.model_validate(SIMULATED_STATION.model_dump(exclude_defaults=True) | sections)
    addresses = {role: found["socket"] for role, found in bench.resources.items()}
    write_addresses(station, addresses | {case.role: bench.resources[case.role][case.transport]}, hasty)
    return station


def _toml(table: Mapping[str, object], path: str = "") -> str:
    """A table as TOML, its own values before the tables in it."""
    own = [f"{key} = {json.dumps(value)}" for key, value in table.items() if not isinstance(value, dict)]
    inner = [_toml(value, f"{path}{key}.") for key, value in table.items() if isinstance(value, dict)]
    return "\n".join(([f"[{path[:-1]}]"] if path and own else []) + own + inner)


def _scope(bench: FaultyBench) -> VirtualDpo72504dx:
    scope = bench._instruments["scope"]
    assert isinstance(scope, VirtualDpo72504dx)
    return scope


def _is_on(bench: FaultyBench, role: str) -> bool:
    instrument = bench._instruments.get(role)
    return isinstance(instrument, VirtualAmplifier | VirtualAttenuator) and instrument.on


def _blank(world: World) -> NDArray[np.float32]:
    """Amplitudes of mirrors that are all off."""
    blank: NDArray[np.float32] = world._pictures._named(np.zeros((1, SIDE**2), np.uint16))[1][0]
    return blank
