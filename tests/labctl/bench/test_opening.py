"""Which benches are opened at all."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from instruments.interfaces import Instrument
from instruments.sections import FOLDER
from instruments.transcripts import Transcript
from instruments.units import WITH_UNITS
from labctl.bench import opening
from labctl.bench.opening import Access, opened, opened_one_by_one
from labctl.bench.simulation import SIMULATED_LASER
from labctl.bench.station import Station
from labctl.errors import StationError
from sim_backends.bench import SimulatedBench
from sim_backends.faults.bench import FaultyBench
from sim_backends.virtual.amplifier.instrument import VirtualAmplifier


def served(bench: FaultyBench, *roles: str) -> dict[str, Any]:
    return {role: {"address": bench.resources[role]["socket"]} for role in roles}


def test_a_bench_that_is_partly_simulated_says_so(log: Transcript) -> None:
    with FaultyBench([]) as bench:
        tables = served(bench, "scope", "awg")
        station = Station.model_validate(tables)
        for reached in (opened, opened_one_by_one):
            with (
                pytest.raises(
                    StationError,
                    match=r"laser, dmd, patch_panel simulated, the other instruments real: .* or mixed = true",
                ),
                reached(station, log),
            ):
                pass
        with opened(Station.model_validate(tables | {"mixed": True}), log) as found:
            assert found.simulation is not None


def test_shots_on_a_real_bench_are_told_apart_where_the_monotonic_clock_has_long_steps(
    log: Transcript, monkeypatch: pytest.MonkeyPatch
) -> None:
    """15.6 ms on Windows before Python 3.13."""
    with FaultyBench([]) as bench:
        tables = served(bench, *bench.resources)
        tables["laser"]["commands"] = SIMULATED_LASER
        clocks = SimpleNamespace(monotonic=lambda: 0.0, perf_counter=time.perf_counter)
        monkeypatch.setattr(opening, "time", clocks)
        with opened(Station.model_validate(tables), log) as found:
            assert found.bench.now() < found.bench.now()


def test_an_instrument_without_an_address_is_told_before_anything_is_asked(log: Transcript) -> None:
    station = Station.model_validate({"mixed": True, "laser": {"address": ""}})
    with (
        pytest.raises(StationError, match=r"laser.address is empty: write its VISA address into built-in station"),
        opened(station, log),
    ):
        pass


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"launch_na": 0.003}, "launch_na 0.003: no mode of a fibre with core_diameter_m 0.0002 lies within it"),
        ({"core_diameter_m": 1e-6}, "launch_na 0.13: no mode of a fibre with core_diameter_m 1e-06 lies within it"),
        ({"collection_core_m": 9e-6, "collected_modes": 8}, "collected_modes 8 exceeds the 6 that there are of coll"),
        ({"collection_core_m": 0.5e-6}, "collected_modes 1 exceeds the 0 that there are of collection_core_m 5e-07"),
    ],
)
def test_a_simulated_fibre_without_the_modes_is_refused(
    parameters: dict[str, float], told: str, log: Transcript
) -> None:
    station = Station.model_validate({"sim": {"parameters": parameters}})
    with (
        pytest.raises(StationError, match=rf"^built-in station: sim\.parameters: {told}"),
        opened(station, log),
    ):
        pass


def test_a_real_amplifier_is_not_driven_by_a_simulated_laser(log: Transcript) -> None:
    amplifier = {"driver": "table-amplifier", "commands": "simulated", "power": "50 mW"}
    with SimulatedBench(plugged_in={"amplifier": VirtualAmplifier}) as bench:
        there = amplifier | {"address": bench.resources["amplifier"]["socket"]}
        station = read({"mixed": True, "amplifier": there})
        for access in (Access(), Access(armed=True)):
            with (
                pytest.raises(StationError, match=r"^built-in station: the laser is simulated, the amplifier is not: "),
                opened(station, log, access),
            ):
                pass
        with opened_one_by_one(station, log) as instruments:
            amplifier_itself = instruments["amplifier"]
            assert isinstance(amplifier_itself, Instrument)
            assert amplifier_itself.identify().model == "optical amplifier (simulated)", "a check may look"
    with opened(read({"mixed": True, "amplifier": amplifier}), log) as found:
        assert found.bench.armed


def read(tables: dict[str, Any]) -> Station:
    return Station.model_validate(tables, context={FOLDER: Path(), WITH_UNITS: True})
