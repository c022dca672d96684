"""`labctl live`: what the detectors see now, several times a second, without a run."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from instruments.bench import Observer
from instruments.units import quantity
from labctl.bench.signals import interruptible
from labctl.bench.station import read_station
from labctl.commands.access import ArmOption, AttendedOption, access_of
from labctl.commands.beside import Beside, past_the_buffer
from labctl.commands.exit_status import DONE
from labctl.commands.options import StationOption
from labctl.commands.output import JsonOption, say, show
from labctl.commands.ranges import ports_of
from labctl.errors import UsageError

if TYPE_CHECKING:
    from labctl.engine.live import Show
    from labctl.runs.live.sight import Sight

BAR, NUMBERS = 48, 62
"""Columns of a level bar at most, and of what stands beside it."""
HIGHER = 1.01
"""A level above the highest so far by this factor rings the bell."""


def live(
    context: typer.Context,
    station: StationOption = None,
    ports: Annotated[
        str, typer.Option("--ports", help='Ports to look at, as many as channels, such as "2-5".')
    ] = "2-5",
    window: Annotated[str, typer.Option("--window", help='Length of a trace, such as "2 ns".')] = "2 ns",
    averages: Annotated[int, typer.Option("--averages", min=1, max=1000, help="Triggers a trace is the mean of.")] = 1,
    wavelength: Annotated[
        str | None, typer.Option("--wavelength", help="Wavelength of the light; without it the station's.")
    ] = None,
    rate: Annotated[float, typer.Option("--rate", min=0.1, max=50, help="Traces a second, at most.")] = 10.0,
    duration: Annotated[str | None, typer.Option("--for", help='End after a time, such as "10 min".')] = None,
    unwatched: Annotated[
        str | None,
        typer.Option("--unwatched", help='End when no page of a dashboard has shown it for a time: "10 min".'),
    ] = None,
    bell: Annotated[bool, typer.Option("--bell", help="Ring when the first port is brighter than ever.")] = False,
    runs: Annotated[Path, typer.Option("--runs", help="Folder of runs in which a dashboard finds it.")] = Path("runs"),
    armed: ArmOption = False,
    attended: AttendedOption = False,
    as_json: JsonOption = False,
) -> int:
    """Show what the detectors see now, several times a second; the bench is dark when it ends. Ctrl-C ends it."""
    found, access = read_station(station), access_of(context, attended=attended, armed=armed)

    from labctl.engine.live import View, watch  # which takes long to load

    view = View(
        found,
        runs,
        ports_of(ports) or (),
        found.laser.wavelength if wavelength is None else _quantity("--wavelength", wavelength, "nm"),
        access,
        _quantity("--window", window, "s"),
        averages,
        rate,
        None if duration is None else _time("--for", duration),
        None if unwatched is None else _time("--unwatched", unwatched),
    )
    with interruptible() as interruption, _level_bars(bell=bell) as (bars, tell):
        viewed = watch(view, interruption, bars, _Warnings(tell))
    result: dict[str, Any] = {
        "view": str(viewed.directory),
        "seconds": round(viewed.seconds, 3),
        "unwatched": viewed.unwatched,
        "looks": 0,
    }
    if (last := viewed.last) is not None:
        result |= {
            "looks": last.looks,
            "looks_per_second": round(last.rate_hz, 2),
            "ports": list(last.ports),
            "level_v": last.now_v.tolist(),
            "peak_v": last.peak_v.tolist(),
            "likeness": [None if math.isnan(one) else one for one in last.likeness[-1]],
        }
    why = "nobody has watched it any more; " if viewed.unwatched else ""
    show(result, as_json, lambda: say(f"{result['looks']} traces in {viewed.seconds:.0f} s; {why}the bench is dark"))
    return DONE


def _quantity(option: str, text: str, unit: str) -> float:
    try:
        return quantity(text, unit)
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from None


def _time(option: str, text: str) -> float:
    if (seconds := _quantity(option, text, "s")) <= 0:
        raise UsageError(f"{option} {text}: is no time to look: write one such as 10 min")
    return seconds


class _Warnings(Observer):
    """A line for each."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell

    def warning(self, text: str) -> None:
        """One line."""
        self._tell(f"labctl: {text}")


class _Bars(Live):
    """Is drawn where the cursor is when it comes back, not over what was written meanwhile."""

    def stop(self) -> None:
        """Away, with its height."""
        self.update("")
        super().stop()


@contextmanager
def _level_bars(*, bell: bool) -> "Iterator[tuple[Show, Callable[[str], None]]]":
    """Level bars on standard error; only where somebody can see them. And what takes lines above them."""
    console = Console(file=past_the_buffer("stderr"), highlight=False, emoji=False)
    seen: deque[Sight | None] = deque(maxlen=1)
    rings = Event()
    highest = -math.inf

    def look(sight: "Sight | None") -> None:
        nonlocal highest
        seen.append(sight)
        if bell and sight is not None and sight.now_v[0] > HIGHER * highest:
            highest = float(sight.now_v[0])
            rings.set()

    def draw() -> None:
        if not (seen and console.is_terminal):
            return
        sight = seen.pop()
        bars.update(_dark() if sight is None else _bars(sight, console.width), refresh=True)
        if rings.is_set():
            rings.clear()
            console.bell()

    bars = _Bars(console=console, auto_refresh=False, transient=True, redirect_stdout=False, redirect_stderr=False)
    beside = Beside(console)
    with beside.writing(bars, draw):
        yield look, beside.tell


def _dark() -> Text:
    return Text("nothing is measured: the laser or the drive is off (labctl dashboard: Laser on)")


def _bars(sight: "Sight", columns: int) -> Group:
    """Level bars for a terminal of so many columns."""
    from labctl.analysis.alignment import LEAST_REPEATS, repeatability_db

    longest = max(1, min(BAR, columns - NUMBERS))
    table = Table(box=None, pad_edge=False)
    for heading in ("port", "level", "peak", "", "repeats", "like first", ""):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    volts = sight.repeated_volts
    low, high = sight.range_v
    of_ports = zip(sight.ports, sight.now_v.tolist(), sight.peak_v.tolist(), strict=True)
    for row, (port, level, peak) in enumerate(of_ports):
        at, held = (round(longest * (value - low) / (high - low)) for value in (level, peak))
        bar = Text("█" * at, style="cyan") + Text(" " * max(held - at - 1, 0)) + Text("▏" if held > at else "")
        repeats = f"{repeatability_db(volts[:, row]).value:.1f} dB" if len(volts) >= LEAST_REPEATS else ""
        table.add_row(
            str(port),
            f"{1e3 * level:.2f} mV",
            f"{1e3 * peak:.2f} mV",
            bar,
            repeats,
            f"{sight.likeness[-1, row]:.3f}",
            Text("CLIPPED", style="bold red") if sight.clipped[row] else "",
        )
    scale = f"bars from {1e3 * low:.0f} to {1e3 * high:.0f} mV"
    return Group(table, Text(f"trace {sight.looks}, {sight.rate_hz:.1f}/s, {scale}; Ctrl-C ends, dark", style="dim"))
