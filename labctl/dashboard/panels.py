"""What there is to see of the channels, as HTML: one set of panels for a live view and for a run."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.alignment import LEAST_REPEATS, repeatability_db
from labctl.analysis.signal_quality import no_codes
from labctl.analysis.spectrum import LEAST_SAMPLES, spectrum
from labctl.dashboard.charts import Axis, Curve, chart, colour
from labctl.dashboard.sketches import escape
from labctl.dashboard.state import ENDED, Phase, RunState
from labctl.runs.live.sight import Sight

OCTAVES = 4
LOWEST_HZ = 110.0
"""The tone of the lowest level that the oscilloscope can tell; the highest is `OCTAVES` above."""
TINY_V = 1e-4
NOTHING = '<p class="nothing">nothing is seen yet</p>'


class Choice(NamedTuple):
    """How traces are drawn: each on a scale of its own or all on that of the oscilloscope; which part, 0 to 1."""

    free: bool = False
    part: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True)
class Panel:
    """A heading; `name` is the CSS class of what stands under it. `quick`: for the eye that follows a hand."""

    name: str
    title: str
    quick: bool = False


PANELS = (
    Panel("levels", "Levels, with the highest so far", quick=True),
    Panel("signals", "Traces", quick=True),
    Panel("codes", "Codes of the oscilloscope, clipped at the dashed lines"),
    Panel("spectrum", "Spectrum"),
    Panel("repeats", "Repeatability"),
    Panel("course", "Drift since the start"),
)


def about(state: RunState) -> str:
    """Where the live view is, whether its drive plays, and what the laser was set to."""
    drive = {None: "", True: "the drive plays", False: "the drive is off: the oscilloscope has no trigger"}[state.drive]
    dark = "dark until the laser is switched on" if state.phase is Phase.PAUSED else ""
    return escape(" · ".join(filter(None, (state.station, dark or drive, state.scope))))


def old(state: RunState, sight: Sight | None) -> str:
    """Why what is shown of the channels is not what they are now; empty where it is."""
    off = "the laser is off" if state.phase is Phase.PAUSED else "the drive is off" if state.drive is False else ""
    why = "the view has ended" if state.phase in ENDED else off
    return "" if sight is None or not why else escape(f"{why}: nothing is measured, what is shown was seen before")


def levels(sight: Sight | None) -> str:
    """A bar for the level of each port, with a mark where it was highest."""
    if sight is None:
        return NOTHING
    axis = _range(sight)
    rows = []
    of_ports = zip(sight.ports, sight.now_v.tolist(), sight.peak_v.tolist(), strict=True)
    for row, (port, level, peak) in enumerate(of_ports):
        at, held = (100 * float(np.clip(axis.place(value), 0, 1)) for value in (level, peak))
        clipped = '<strong class="clipped">CLIPPED</strong>' if sight.clipped[row] else ""
        rows.append(
            f'<div class="level"><span class="port">port {port}</span>'
            f'<div class="track" role="meter" aria-label="level of port {port}" aria-valuenow="{1e3 * level:.2f}" '
            f'aria-valuemin="{1e3 * axis.low:.0f}" aria-valuemax="{1e3 * axis.high:.0f}">'
            f'<div class="fill {colour(row)}" style="width:{at:.2f}%"></div>'
            f'<div class="peak" style="left:{held:.2f}%"></div></div>'
            f'<span class="volts">{1e3 * level:.2f} mV<small>{1e3 * peak:.2f}</small>{clipped}</span></div>'
        )
    tones = ",".join(f"{one:.1f}" for one in _tones(sight, axis))
    seen = f"trace {sight.looks}, {sight.rate_hz:.1f} a second" if sight.rate_hz else f"{sight.looks} shots"
    scale = f"{1e3 * axis.low:.0f} to {1e3 * axis.high:.0f} mV, {seen}"
    return f'<div class="levels" data-tones="{tones}">{"".join(rows)}</div><p class="caption">{scale}</p>'


def signals(sight: Sight | None, choice: Choice) -> str:
    """The last trace of each port."""
    if sight is None:
        return NOTHING
    volts = sight.volts[-1]
    time_s = np.arange(volts.shape[1]) * sight.sample_interval_s
    whole_s = max(float(time_s[-1]), sight.sample_interval_s)
    x = Axis(choice.part[0] * whole_s, choice.part[1] * whole_s, "ns", 1e9)
    drawn = []
    for row, port in enumerate(sight.ports):
        y = _around(volts[row]) if choice.free else _range(sight)
        drawn.append(chart(f"port {port}", [Curve(time_s, volts[row], style=colour(row))], x, y))
    return "".join(drawn)


def codes(sight: Sight | None) -> str:
    """How often each code occurs in the last looks."""
    if sight is None:
        return NOTHING
    counted = no_codes(len(sight.ports), sight.recent.dtype).with_more(sight.recent)
    width = int(counted.first_code[1] - counted.first_code[0])
    edges = np.append(counted.first_code, counted.first_code[-1] + width).astype(np.float64)
    part = counted.counts / max(1, int(counted.counts[0].sum()))
    curves = [
        Curve(np.repeat(edges, 2)[1:-1], np.repeat(part[row], 2), f"port {port}", colour(row))
        for row, port in enumerate(sight.ports)
    ]
    x = Axis(edges[0] - 8 * width, edges[-1] + 8 * width)
    clipped = ", ".join(
        f"port {port} {100 * part:.2g} %" for port, part in zip(sight.ports, sight.clipped, strict=True) if part
    )
    title = (
        f"part of the samples at an end of the range: {clipped}" if clipped else "no sample is at an end of the range"
    )
    return chart(title, curves, x, Axis(0.0, float(part.max()) or 1.0, "%", 100), marks=(edges[0], edges[-1]))


def frequencies(sight: Sight | None) -> str:
    """The mean spectrum of the last looks, of each port."""
    if sight is None or sight.recent.shape[2] < LEAST_SAMPLES:
        return NOTHING
    found = spectrum(sight.volts, sight.sample_interval_s)
    density_db = 10 * np.log10(np.maximum(found.density, 1e-30))
    curves = [
        Curve(found.frequency_hz, density_db[row], f"port {port}", colour(row)) for row, port in enumerate(sight.ports)
    ]
    high = 10 * float(np.ceil(density_db.max() / 10))
    low = 10 * float(np.floor(np.percentile(density_db, 2) / 10))
    title = f"power density, mean of {len(sight.recent)} traces, dB of 1 V²/Hz"
    return chart(title, curves, Axis(0.0, float(found.frequency_hz[-1]), "GHz", 1e-9), Axis(low, max(high, low + 10)))


def repeats(sight: Sight | None) -> str:
    """How well the last looks at one picture agree."""
    if sight is None or len(volts := sight.repeated_volts) < LEAST_REPEATS:
        return NOTHING
    noise_v = np.sqrt(volts.var(axis=0, ddof=1).mean(axis=1))
    rows = "".join(
        f"<tr><th>port {port}</th><td>{repeatability_db(volts[:, row]).value:.1f} dB</td>"
        f"<td>{1e3 * noise_v[row]:.2f} mV</td><td>{_correlation(sight, row)}</td></tr>"
        for row, port in enumerate(sight.ports)
    )
    head = "<tr><th></th><th>signal to noise</th><th>noise, rms</th><th>like first</th></tr>"
    return f'<table class="repeats">{head}{rows}</table><p class="caption">of {len(volts)} traces of one picture</p>'


def course(sight: Sight | None) -> str:
    """How level and shape of the traces of one picture went since the start."""
    if sight is None or not sight.elapsed_s.size:
        return NOTHING
    minutes = sight.elapsed_s[-1] > 300
    x = Axis(0.0, max(float(sight.elapsed_s[-1]), 1.0), "min" if minutes else "s", 1 / 60 if minutes else 1.0)
    first = np.where(np.abs(sight.level_v[0]) > TINY_V, sight.level_v[0], np.nan)
    change = 100 * (sight.level_v / first - 1)
    names = [(f"port {port}", colour(row)) for row, port in enumerate(sight.ports)]
    most = max(1.0, float(np.nanmax(np.abs(change), initial=0.0)))
    likeness = [Curve(sight.elapsed_s, sight.likeness[:, row], *name) for row, name in enumerate(names)]
    level = [Curve(sight.elapsed_s, change[:, row], *name) for row, name in enumerate(names)]
    least = min(0.9, float(np.nanmin(sight.likeness, initial=1.0)))
    return chart("level, change in %", level, x, Axis(-most, most, "%")) + chart(
        "correlation with the first trace", likeness, x, Axis(least, 1.0)
    )


def _tones(sight: Sight, axis: Axis) -> list[float]:
    """The tone of each port, Hz: the level in octaves."""
    return [LOWEST_HZ * 2 ** (OCTAVES * float(np.clip(axis.place(one), 0, 1))) for one in sight.now_v]


def _range(sight: Sight) -> Axis:
    """From end to end of what the oscilloscope can tell, the same for all ports."""
    return Axis(*sight.range_v, "mV", 1e3)


def _around(volts: NDArray[np.float64]) -> Axis:
    low, high = float(volts.min()), float(volts.max())
    room = max(0.05 * (high - low), TINY_V)
    return Axis(low - room, high + room, "mV", 1e3)


def _correlation(sight: Sight, row: int) -> str:
    found = sight.likeness[-1, row]
    return escape(f"{found:.3f}" if np.isfinite(found) else "constant")
