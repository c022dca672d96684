from typing import Any

import pytest

from labctl.runs.format.origin import Origin

SIM, REAL, HAND = "SIM0001", "B010101", ""
ADDRESS = "TCPIP0::192.168.0.2::4000::SOCKET"


def manifest(**instruments: tuple[str, str, str]) -> dict[str, Any]:
    """Of instruments with driver, address and serial number; those set by hand have no maker."""
    return {
        "station": {role: {"driver": driver, "address": at} for role, (driver, at, _) in instruments.items()},
        "instruments": {
            role: {"identity": {"manufacturer": "ACME" if serial else "", "model": driver, "serial": serial}}
            for role, (driver, _, serial) in instruments.items()
        },
    }


AWG, SCOPE = ("tektronix-awg70002a", ADDRESS, REAL), ("tektronix-dpo72504dx", ADDRESS, REAL)
BY_HAND = ("manual-laser", "simulated", HAND)


@pytest.mark.parametrize(
    ("found", "origin"),
    [
        (manifest(awg=AWG, scope=SCOPE, laser=BY_HAND, dmd=("vialux-alp", "usb", "13042")), Origin.REAL),
        (manifest(awg=AWG, scope=("own-scope", "simulated", "1")), Origin.MIXED),
        (manifest(awg=("own-awg", "simulated", "1"), laser=BY_HAND), Origin.SIMULATED),
        (manifest(awg=("own-awg", ADDRESS, SIM), dmd=("vialux-alp", ADDRESS, "13042")), Origin.SIMULATED),
        (manifest(awg=AWG) | {"replay": [{"name": "bench.rec", "sha256": "0" * 64}]}, Origin.REPLAYED),
        ({}, Origin.REAL),
        ({"station": 3, "instruments": {"awg": 4}}, Origin.REAL),
    ],
    ids=["a bench", "one simulated", "all simulated", "served", "replayed", "nothing known", "damaged"],
)
def test_simulated_instruments_are_known_by_address_and_serial_number(found: dict[str, Any], origin: Origin) -> None:
    assert Origin.of(found) is origin


def test_records_of_both_are_partly_simulated() -> None:
    assert Origin.together([Origin.REAL, Origin.SIMULATED]) is Origin.MIXED
    assert Origin.together([Origin.REAL, Origin.REAL]) is Origin.REAL
