"""The virtual instruments: what a client of each real one can see, and what it does to the light."""

from sim_backends.virtual.alp.instrument import VirtualAlp
from sim_backends.virtual.amplifier.instrument import VirtualAmplifier
from sim_backends.virtual.attenuator.instrument import VirtualAttenuator
from sim_backends.virtual.awg70002a.instrument import VirtualAwg70002a
from sim_backends.virtual.dpo72504dx.instrument import VirtualDpo72504dx
from sim_backends.virtual.fibre_switch.instrument import VirtualFibreSwitch
from sim_backends.virtual.instrument import VirtualInstrument
from sim_backends.virtual.mso6b.instrument import VirtualMso6b
from sim_backends.virtual.pm100.instrument import VirtualPm100
from sim_backends.virtual.tlg220.instrument import VirtualTlg220
from sim_backends.virtual.tsl570.instrument import VirtualTsl570

__all__ = [
    "VirtualAlp",
    "VirtualAmplifier",
    "VirtualAttenuator",
    "VirtualAwg70002a",
    "VirtualDpo72504dx",
    "VirtualFibreSwitch",
    "VirtualInstrument",
    "VirtualMso6b",
    "VirtualPm100",
    "VirtualTlg220",
    "VirtualTsl570",
]
