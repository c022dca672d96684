"""Which benches are opened at all."""

from typing import Any

import pytest

from instruments.transcripts import Transcript
from labctl.bench.opening import opened, opened_one_by_one
from labctl.bench.station import Station
from labctl.errors import StationError
from sim_backends.faults.bench import FaultyBench


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


def test_an_instrument_without_an_address_is_told_before_anything_is_asked(log: Transcript) -> None:
    station = Station.model_validate({"mixed": True, "laser": {"address": ""}})
    with (
        pytest.raises(StationError, match=r"laser.address is empty: write its VISA address into built-in station"),
        opened(station, log),
    ):
        pass
