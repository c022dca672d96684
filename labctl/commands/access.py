"""How a command opens its benches: what its options allow, and whether it is recorded or replayed."""

from typing import Annotated

import typer

from labctl.bench.opening import Access
from labctl.bench.recording.wire import Wire

ArmOption = Annotated[
    bool, typer.Option("--arm", help="Light may be switched on; as armed = true under [laser] of the station file.")
]
AttendedOption = Annotated[bool, typer.Option("--attended", help="Somebody stands at the laser's key switch.")]


def access_of(context: typer.Context, *, attended: bool = False, armed: bool = False) -> Access:
    """As the options say; on the wire of the `labctl record` or `labctl replay` that carries the command out."""
    return Access(attended, armed, context.find_object(Wire) or Wire.of_this_process())
