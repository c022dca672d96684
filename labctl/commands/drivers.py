"""`labctl drivers`: which instruments labctl can drive here, and which of them it can simulate."""

from dataclasses import asdict

from labctl.bench.drivers import Listed, listed
from labctl.bench.simulation import SIMULATED_DRIVERS
from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, show, table


def drivers(as_json: JsonOption = False) -> int:
    """List the installed drivers: role, interface, package, and the package that simulates the instrument."""
    found = listed(SIMULATED_DRIVERS)
    show({"drivers": [asdict(one) for one in found]}, as_json, lambda: _print(found))
    return DONE


def _print(found: list[Listed]) -> None:
    table(
        ("driver", "role", "interface", "package", "simulated by"),
        ((one.name, one.role, one.interface, one.package, one.virtual or "-") for one in found if not one.problem),
    )
    for one in found:
        if one.problem:
            say(f"{one.name} of {one.package} does not load: {one.problem}")
