"""Asking a bench what documents leave open: each instrument in the dark, then all together with light."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from instruments.bench import Bench
from instruments.interfaces import BYPASS_PORT, BurstDmd
from instruments.values import Answer
from labctl.bench import answers
from labctl.bench.laser_limits import check_laser
from labctl.bench.lock import held
from labctl.bench.opening import Access, opened
from labctl.bench.station import Station
from labctl.bench.supervision import supervised
from labctl.engine.inputs import images_for
from labctl.runs.live.logs import CommandLog
from protocols.base import Shot, ShotKind
from protocols.image_readout import ImageReadout
from protocols.open_questions import switches, switching_answers, trigger_levels
from protocols.patterns import Patterns

SEED, PROBES = 1, 16


@dataclass(frozen=True)
class Asked:
    """What a bench answered, and the file that keeps it."""

    answers: tuple[Answer, ...]
    path: Path


def ask_bench(station: Station, log: CommandLog, access: Access, *, light: bool) -> Asked:
    """Measure what is open about the bench of `station`; what needs light only if `light` is asked for.

    Raises:
        StationError, OutOfRange, NotConfigured: the station is wrong or not armed; no light was switched on.
        InstrumentError: an instrument failed; the bench is in the safe state.
        RunError: the answers cannot be written.
    """
    started = datetime.now(UTC)
    with ExitStack() as stack:
        hold = stack.enter_context(held(station, "labctl check --deep", access.wire))
        supervisor = stack.enter_context(supervised(station, log, access.wire, hold.descriptors))
        bench = stack.enter_context(opened(station, log, access, observer=supervisor)).bench
        if light:
            check_laser(station, (station.laser.wavelength,))
            bench.require_arm()
        found = tuple(_answers(bench, station.laser.wavelength, light=light))
    return Asked(found, answers.save(station, found, started))


def _answers(bench: Bench, wavelength_nm: float, *, light: bool) -> Iterator[Answer]:
    for instrument in bench.instruments.values():
        yield from instrument.answers()
    if not light:
        return
    yield from trigger_levels(bench, SEED)
    dmd = bench.dmd
    if bench.wiring.burst and bench.wiring.projector and isinstance(dmd, BurstDmd):
        port = BYPASS_PORT if BYPASS_PORT in bench.patch_panel.ports else bench.patch_panel.ports[0]
        images = images_for(ImageReadout(images=PROBES, seed=SEED))
        fullest = int(images.indices[np.count_nonzero(images.images, axis=(1, 2)).argmax()])
        picture = Patterns(images, dmd.shape)[Shot(0, ShotKind.IMAGE, fullest, 0, 0)]
        channel = bench.wiring.channels[0]
        bench.connect({channel: port})
        with bench.emitting(wavelength_nm):
            yield from switching_answers(dmd.settling_s, *switches(bench, dmd, channel, picture))
