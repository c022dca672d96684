"""The drivers that come with labctl, by the names a station file uses.

Each is an entry point of the group `labctl.instruments`: a function of the section of the station file and of the
`Opening` that returns the instrument. A driver of another package plugs in the same way.
"""

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from instruments.alnair_tlg220 import DEFAULT_TABLE, CommandTable, Tlg220
from instruments.fibre_switch import ScpiFibreSwitch
from instruments.interfaces import Awg, Dmd, Oscilloscope, PatchPanel, TunableLaser
from instruments.manual import Ask, ManualLaser, ManualPatchPanel
from instruments.tektronix_awg70002a import Awg70002a
from instruments.tektronix_dpo72504dx import Dpo72504dx
from instruments.ti_dlpc900 import HidApi, TiDlpc900
from instruments.transcripts import Transcript
from instruments.vialux_alp import AlpByVendorLibrary, AlpOverVisa, VialuxAlp
from instruments.visa import VisaLink, tektronix_event_queue
from labctl.bench.station import AwgSection, DmdSection, LaserSection, PatchPanelSection, ScopeSection
from labctl.errors import StationError

GROUP = "labctl.instruments"
USB = "usb"
"""The address of a DMD on the vendor's own USB library instead of the network."""

RECOGNISED = (
    ("awg", "tektronix-awg70002a", re.compile(r"TEKTRONIX AWG70\d{3}", re.IGNORECASE)),
    ("scope", "tektronix-dpo72504dx", re.compile(r"TEKTRONIX (DPO|DSA|MSO)7\d{4}", re.IGNORECASE)),
    ("laser", "alnair-tlg-220", re.compile(r"Alnair.*TLG-?2\d0", re.IGNORECASE)),
    ("dmd", "vialux-alp", re.compile(r"ViALUX ALP", re.IGNORECASE)),
    ("patch_panel", "scpi-fibre-switch", re.compile(r"switch", re.IGNORECASE)),
)
"""Instrument, its driver, and what maker and model of such a one read like."""


@dataclass(frozen=True)
class Opening:
    """What a driver gets besides its section of the station file.

    address: where the instrument is. transcript: logs every message. ask: asks the operator. attended: whether somebody
    is at the bench. simulated_laser: command table of the simulated laser.
    """

    address: str
    transcript: Transcript
    ask: Ask
    attended: bool
    simulated_laser: Path


def driver(name: str) -> Callable[[Any, Opening], Any]:
    """The function that opens the driver called `name`.

    Raises:
        StationError: no installed package offers it.
    """
    found = _installed(tuple(sys.path))
    if name not in found:
        raise StationError(f"driver = {name!r} is not installed: choose one of {', '.join(sorted(found))}")
    opens: Callable[[Any, Opening], Any] = found[name].load()
    return opens


@cache
def _installed(_search_path: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Looked up once for each search path: that reads a file of every package, and a bench has five drivers."""
    return {point.name: point for point in entry_points(group=GROUP)}


def tektronix_awg70002a(section: AwgSection, opening: Opening) -> Awg:
    """Tektronix AWG70002A over VISA."""
    link = VisaLink(opening.address, name="awg", timeout_s=section.timeout, transcript=opening.transcript)
    return Awg70002a(link, channel=section.channel)


def tektronix_dpo72504dx(section: ScopeSection, opening: Opening) -> Oscilloscope:
    """Tektronix DPO72504DX over VISA."""
    return Dpo72504dx(
        VisaLink(
            opening.address,
            name="scope",
            timeout_s=section.timeout,
            transcript=opening.transcript,
            error_queue=tektronix_event_queue,
        )
    )


def alnair_tlg220(section: LaserSection, opening: Opening) -> TunableLaser:
    """Alnair Labs TLG-220 with the operator's command table.

    Raises:
        NotConfigured: the table has gaps, or is not verified and nobody is at the bench.
    """
    chosen = section.commands or DEFAULT_TABLE
    table = CommandTable.read(opening.simulated_laser if str(chosen) == "simulated" else chosen)
    table.require_complete()
    if not opening.attended:
        table.require_verified()
    return Tlg220(opening.address, table, opening.transcript)


def manual_laser(_section: LaserSection, opening: Opening) -> TunableLaser:
    """A laser the operator sets by hand."""
    return ManualLaser(opening.ask)


def vialux_alp(section: DmdSection, opening: Opening) -> Dmd:
    """ViALUX ALP on USB by the vendor's library, or served on the network."""
    if opening.address == USB:
        return VialuxAlp(AlpByVendorLibrary(section.version, section.library))
    link = VisaLink(opening.address, name="dmd", timeout_s=section.timeout, transcript=opening.transcript)
    return VialuxAlp(AlpOverVisa(link))


def ti_dlpc900(section: DmdSection, opening: Opening) -> Dmd:
    """TI DLPC900 (LightCrafter 6500) on USB.

    Raises:
        StationError: another address.
    """
    if opening.address != USB:
        raise StationError(
            f"dmd.address = {opening.address!r}: driver = {section.driver!r} is on USB only: write address = {USB!r}"
        )
    return TiDlpc900(HidApi())


def scpi_fibre_switch(section: PatchPanelSection, opening: Opening) -> PatchPanel:
    """Optical matrix switch over VISA."""
    link = VisaLink(opening.address, name="patch_panel", timeout_s=section.timeout, transcript=opening.transcript)
    return ScpiFibreSwitch(link, ports=section.ports)


def manual_patch_panel(section: PatchPanelSection, opening: Opening) -> PatchPanel:
    """Fibres moved by the operator."""
    return ManualPatchPanel(opening.ask, ports=section.ports)
