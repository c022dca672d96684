"""What instruments might answer: replies of the simulated bench that are changed on the wire, read by the drivers."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st

from instruments.alnair_tlg220 import Tlg220
from instruments.alp_library import AlpOverVisa
from instruments.errors import InstrumentError
from instruments.fibre_switch import ScpiFibreSwitch
from instruments.interfaces import Instrument
from instruments.laser_table import LaserTable
from instruments.tektronix_awg70002a import Awg70002a
from instruments.tektronix_dpo72504dx import Dpo72504dx
from instruments.values import Drive, EdgeTrigger, Timebase, Vertical
from instruments.vialux_alp import VialuxAlp
from instruments.visa import VisaLink, tektronix_event_queue
from labctl.bench.simulation import SIMULATED_LASER
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import Fault, Moment
from sim_backends.servers.disturbed import Disturbed
from tests.faults.matrix import SMALL, short_waits
from tests.fuzz.changes import CHANGES, END, changed
from tests.fuzz.link import COUNTED

TIMEOUT_S = 0.2
PATIENCE_S = 10.0  # with the instrument that is not changed
LONGEST_ERROR = 2000  # characters
DRIVE = Drive("fuzzed", np.linspace(-1, 1, 2400, dtype=np.float32), 25e9, 0.5)
CHANNELS = (1, 2)
PICTURES = np.zeros((2, 768, 128), np.uint8)

Addresses = Mapping[str, Mapping[str, str]]
Step = Callable[[], object]


class Life(NamedTuple):
    """What is asked of an instrument, step by step; messages: about how many that are.

    transports: those by which it is reached.
    """

    instrument: Callable[[Addresses, str], Instrument]
    steps: Callable[[Any], Iterator[Step]]
    messages: int
    transports: tuple[str, ...] = ("socket", "hislip")


def answers_are_taken_or_refused(data: st.DataObject, role: str) -> None:
    """Whatever an instrument answers, at whatever moment: its driver goes on, or refuses it in one line.

    A raw socket whose reply would never come to an end is closed behind it: every wait is bounded, but costs its bound.
    """
    COUNTED["inputs"] += 1
    COUNTED[f"answers of {role}"] += 1
    life = LIVES[role]
    moment = Moment("", data.draw(st.integers(1, life.messages)), data.draw(st.sampled_from((1, 1, 2, 5))))
    transport = data.draw(st.sampled_from(life.transports))
    changes, end = data.draw(CHANGES), data.draw(END)
    fault = Fault("changed", reply=lambda reply: _sent(changed(reply, changes, end), transport))
    with FaultyBench([Befalling(role, fault, moment)], SMALL) as bench, short_waits(role):
        instrument = life.instrument(bench.resources, transport)
        for phase in (life.steps(instrument), iter((instrument.make_safe, instrument.close))):
            try:
                for step in phase:
                    step()
            except InstrumentError as error:
                assert len(str(error).splitlines()) == 1, repr(str(error))  # noqa: PT017
                assert len(str(error)) < LONGEST_ERROR  # noqa: PT017


def _sent(reply: bytes, transport: str) -> Disturbed:
    ends = reply.endswith(b"\n") and not reply.startswith(b"#") and reply.count(b'"') % 2 == 0
    return Disturbed(reply, ends_after=len(reply) if transport == "socket" and not ends else None)


def _unheard(*_message: str) -> None:
    """A transcript that nobody keeps."""


def _link(addresses: Addresses, role: str, transport: str, timeout_s: float = TIMEOUT_S, **options: Any) -> VisaLink:
    return VisaLink(addresses[role][transport], name=role, timeout_s=timeout_s, transcript=_unheard, **options)


def _laser(addresses: Addresses, transport: str) -> Tlg220:
    table = LaserTable.read(SIMULATED_LASER)
    settling = table.commands["is_settled"].model_copy(update={"timeout_s": TIMEOUT_S, "poll_s": 0.01})
    hasty = {
        "commands": {**table.commands, "is_settled": settling},
        "transport": table.transport.model_copy(update={"timeout_s": TIMEOUT_S}),
    }
    return Tlg220(addresses["laser"][transport], table.model_copy(update=hasty), _unheard)


def _awg(addresses: Addresses, transport: str) -> Awg70002a:
    return Awg70002a(_link(addresses, "awg", transport))


def _scope(addresses: Addresses, transport: str) -> Dpo72504dx:
    """With an AWG that plays, whose marker triggers it."""
    awg = Awg70002a(_link(addresses, "awg", "socket", timeout_s=PATIENCE_S))
    awg.load(DRIVE)
    awg.play()
    awg.close()
    return Dpo72504dx(_link(addresses, "scope", transport, error_queue=tektronix_event_queue))


def _dmd(addresses: Addresses, transport: str) -> VialuxAlp:
    return VialuxAlp(AlpOverVisa(_link(addresses, "dmd", transport)))


def _switch(addresses: Addresses, transport: str) -> ScpiFibreSwitch:
    return ScpiFibreSwitch(_link(addresses, "patch_panel", transport), ports=(1, 2, 3))


def _examined(instrument: Instrument) -> Iterator[Step]:
    yield instrument.identify
    yield instrument.examine
    yield instrument.self_test


def _of_the_laser(laser: Tlg220) -> Iterator[Step]:
    yield from _examined(laser)
    yield partial(laser.tune, 1550.0)
    yield partial(laser.set_power, 0.02)
    yield laser.emit
    yield laser.power
    yield laser.require_emission
    yield laser.settings


def _of_the_awg(awg: Awg70002a) -> Iterator[Step]:
    yield from _examined(awg)
    yield partial(awg.load, DRIVE)
    yield awg.play
    yield awg.settings


def _of_the_scope(scope: Dpo72504dx) -> Iterator[Step]:
    yield from _examined(scope)
    yield partial(scope.configure, Timebase(50e9, 60, 0.0), EdgeTrigger("AUX", 0.5), CHANNELS, 1)
    for channel in CHANNELS:
        yield partial(scope.set_vertical, channel, Vertical(0.05, 0.0))
    yield scope.arm
    yield scope.wait
    yield scope.read
    yield scope.scalings
    yield scope.most_frames
    yield partial(scope.arm_burst, 3)
    yield scope.read_burst
    yield scope.settings


def _of_the_dmd(dmd: VialuxAlp) -> Iterator[Step]:
    yield from _examined(dmd)
    yield partial(dmd.show, PICTURES[0])
    yield partial(dmd.load, [PICTURES], len(PICTURES))
    yield partial(dmd.play, 0, len(PICTURES), 1e-3)
    yield dmd.hold
    yield dmd.settings


def _of_the_switch(switch: ScpiFibreSwitch) -> Iterator[Step]:
    yield from _examined(switch)
    yield partial(switch.connect, {1: 2, 2: 3})
    yield switch.settings


LIVES: Mapping[str, Life] = {
    "laser": Life(_laser, _of_the_laser, 30),
    "awg": Life(_awg, _of_the_awg, 60, ("socket", "hislip", "vxi11")),
    "scope": Life(_scope, _of_the_scope, 100, ("socket", "hislip", "vxi11")),
    "dmd": Life(_dmd, _of_the_dmd, 40),
    "patch_panel": Life(_switch, _of_the_switch, 12),
}
