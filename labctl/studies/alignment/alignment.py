"""Aligning a bench: the pieces of `protocols.alignment` one after the other, what each says, and its picture."""

import logging
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench, Observer, Observers
from instruments.errors import NoTrigger
from instruments.interfaces import BYPASS_PORT
from instruments.values import Scaling
from labctl.analysis.decorrelation import Scan
from labctl.bench import calibration
from labctl.bench.identity import who_they_are
from labctl.bench.laser_limits import check_laser
from labctl.bench.lock import Hold
from labctl.bench.opening import Access, opened
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.bench.supervision import supervised
from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError, StationError, UsageError, writing
from labctl.reports.alignment import alignment_report
from labctl.runs.format.layout import is_taken
from labctl.runs.format.manifest import REPLAY
from labctl.runs.format.origin import Origin
from labctl.runs.live.logs import CommandLog
from labctl.runs.write.room import require
from labctl.studies.alignment.findings import Finding
from labctl.studies.alignment.steps import (
    Result,
    lit_channels,
    of_contrast,
    of_dark,
    of_decorrelation,
    of_delay,
    of_depth,
    of_range,
    of_repeats,
    unmeasured,
)
from protocols.alignment import (
    DIRECT_STEP_NM,
    DIRECT_WAVELENGTHS,
    FINE_RATE,
    PROBES,
    Answered,
    Dark,
    Hopped,
    Piece,
    Ranged,
    Repeated,
    align,
)
from protocols.base import Images, PassStarted, ShotKind
from protocols.image_readout import DRIVE_RATE, ImageReadout
from protocols.wavelength_scan import WavelengthScan

LARGEST_BYTES = 16_000_000
"""Four times what an alignment of the simulated bench writes: log, report and figures."""
SEED = 1
SCAN = WavelengthScan(steps=14, seed=SEED)
STEPS = ("dark", "range", "repeatability", "contrast", "delay", "depth", "decorrelation")
WITH_PROJECTOR = ("contrast", "depth", "decorrelation")

Tell = Callable[[Finding], None]

_logger = logging.getLogger(__name__)


class _Warned(Observer):
    """Whoever aligns reads warnings at once."""

    def warning(self, text: str) -> None:
        _logger.warning("%s", text)


@dataclass(frozen=True)
class Aligned:
    """How an alignment went: its folder, calibration (None where no bench was measured), report and findings."""

    directory: Path
    calibration: Path | None
    report: Path
    findings: tuple[Finding, ...]

    @property
    def good(self) -> bool:
        """Whether there is nothing to do."""
        return all(finding.good for finding in self.findings)


def align_bench(
    station: Station,
    access: Access,
    hold: Hold,
    *,
    directory: Path | None,
    interruption: Interruption,
    tell: Tell,
) -> Aligned | None:
    """Measure the bench of `station`, which `hold` holds; `tell` hears of each finding at once. None: interrupted.

    A step that falls short does not keep those from being measured that make sense without it. Where a recording
    answers there is no calibration: it says nothing of the bench as it is now.

    Raises:
        StationError, OutOfRange, NotConfigured: The station is wrong or not armed; no light was switched on.
        InstrumentError: An instrument failed; the bench is in the safe state.
        RunError: The folder cannot be written, or there is no room for it; no light was switched on.
    """
    started = datetime.now(UTC)
    folder = directory or calibration.new_folder(station, started)
    if is_taken(folder):
        raise UsageError(f"{folder}: is not empty: name a new directory")
    images = images_for(ImageReadout(images=PROBES, seed=SEED))
    results: list[Result] = []
    with ExitStack() as stack:
        log = stack.enter_context(CommandLog())
        supervisor = stack.enter_context(supervised(station, log, access.wire, hold.descriptors))
        observers = Observers(hold, supervisor, _Warned())
        bench = stack.enter_context(opened(station, log, access, observer=observers)).bench
        last = station.laser.wavelength + (0 if station.wiring.projector else DIRECT_STEP_NM * (DIRECT_WAVELENGTHS - 1))
        check_laser(station, (station.laser.wavelength, last))
        bench.scope.require_rate(FINE_RATE)
        bench.require_arm()
        instruments = {
            name: {"identity": vars(identity), "settings": bench.instruments[name].settings()}
            for name, identity in who_they_are(station, bench).items()
        }
        with writing(folder, "name another --out"):
            folder.mkdir(parents=True, exist_ok=True)
        require(folder, LARGEST_BYTES)
        log.stored_in(folder)
        for result in stack.enter_context(closing(_measured(station, bench, images))):
            for finding in result.findings:
                tell(finding)
            results.append(result)
            if interruption.requested:
                return None
    findings = tuple(finding for result in results for finding in result.findings)
    measured = any(finding.estimate is not None for finding in findings)
    kept = (
        calibration.save(folder, station, [one.values() for one in findings], instruments, started)
        if measured and access.wire.replay is None
        else None
    )
    played = [one.model_dump() for one in access.wire.played]
    report = alignment_report(
        folder,
        station.name,
        started,
        findings=[(one.subject, one.found, one.criterion, one.advice or "good") for one in findings],
        figures={one.step: one.figure for one in results if one.figure is not None},
        origin=Origin.of({"station": station.model_dump(mode="json"), "instruments": instruments, REPLAY: played}),
    )
    return Aligned(folder, kept, report, findings)


def _measured(station: Station, bench: Bench, images: Images) -> Generator[Result, None, None]:
    """What each step says, in their order; those that cannot be measured say why."""
    done: set[str] = set()
    reason = ""
    try:
        with closing(_results(station, bench, images)) as results:
            for result in results:
                done.add(result.step)
                yield result
                reason = result.ends
                if reason:
                    break
    except NoTrigger as error:
        reason = str(error)
    for step in STEPS:
        if step not in done and (station.wiring.projector or step not in WITH_PROJECTOR):
            yield Result(step, (Finding(step, step, None, None, "1", f"not measured: {reason}"),))


def _results(station: Station, bench: Bench, images: Images) -> Generator[Result, None, None]:
    ports = [port for port in station.patch_panel.ports if port != BYPASS_PORT] or [BYPASS_PORT]
    patching = bench.patchings_for(ports)[0]
    channels = tuple(patching)
    nm = station.laser.wavelength
    pieces = align(bench, images, ports=tuple(patching.values()), wavelength_nm=nm, seed=SEED)
    with closing(pieces):
        dark = next(piece for piece in pieces if isinstance(piece, Dark))
        yield of_dark(dark, channels)
        ranged = next(piece for piece in pieces if isinstance(piece, Ranged))
        yield of_range(ranged, dark, channels, projector=bench.wiring.projector)
        lit = lit_channels(ranged, dark)
        if bench.wiring.projector:
            yield of_contrast(ranged, dark, channels, lit)
        for piece in pieces:
            yield _result(piece, channels, lit)
    if bench.wiring.projector:
        yield _scanned(station, bench)


def _result(piece: Piece, channels: tuple[int, ...], lit: NDArray[np.bool_]) -> Result:
    match piece:
        case Answered():
            step, what = "delay", "trigger to light"
        case _:
            step, what = "depth", "drive depth"
    try:
        match piece:
            case Repeated():
                return of_repeats(piece, channels, lit)
            case Answered():
                return of_delay(piece)
            case Hopped():
                return of_depth(piece)
    except AnalysisError as error:
        return unmeasured(step, what, error)
    raise TypeError(f"{type(piece).__name__} comes first")


def _scanned(station: Station, bench: Bench) -> Result:
    """A scan as `labctl run wavelength-scan` does, from the station's wavelength on; of the fibre if it is wired."""
    step, what = "decorrelation", "half width of the speckle's correlation with wavelength"
    port = BYPASS_PORT if BYPASS_PORT in bench.patch_panel.ports else station.patch_panel.ports[0]
    scan = SCAN.model_copy(update={"start": station.laser.wavelength, "ports": (port,)})
    try:
        check_laser(station, scan.wavelengths)
        return of_decorrelation(_scan(scan, bench))
    except (AnalysisError, StationError) as error:
        return Result(step, (Finding(step, what, None, None, "m", f"not measured: {error}"),))


def _scan(protocol: WavelengthScan, bench: Bench) -> Scan:
    inputs = images_for(protocol)
    parts = protocol.parts(bench, inputs)
    shots = parts[0].shots
    traces: dict[tuple[int, int], NDArray[np.float64]] = {}
    again: dict[int, NDArray[np.float64]] = {}
    scalings: tuple[Scaling, ...] = ()
    events = protocol.acquire(bench, inputs, parts)
    with closing(events):
        for event in events:
            if isinstance(event, PassStarted):
                scalings = event.scalings
            elif (shot := shots[event.first]).kind is not ShotKind.DARK:
                volts = scalings[0].scale_v * event.frames.codes[0].astype(np.float64) + scalings[0].offset_v
                key = event.pass_.index, shot.dataset_index
                if shot.kind is ShotKind.REFERENCE:
                    again[event.pass_.index] = volts - traces[key]
                else:
                    traces[key] = volts
    shown = sorted({image for _, image in traces})
    return Scan(
        traces=np.array([[traces[pass_, image] for image in shown] for pass_ in range(protocol.steps)]),
        repeats=np.array([[again[pass_]] for pass_ in range(protocol.steps)]),
        centre_nm=float(np.mean(protocol.wavelengths)),
        step_nm=protocol.step,
        symbol_s=1 / DRIVE_RATE,
        ports=protocol.ports,
    )
