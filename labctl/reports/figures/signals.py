"""The figure of a look at the channels: levels, traces, codes and spectrum, as on the panels of the dashboard."""

import numpy as np
from matplotlib.figure import Figure

from instruments.ports import port_name
from labctl.analysis.signal_quality import no_codes
from labctl.analysis.spectrum import LEAST_SAMPLES, spectrum
from labctl.reports.canvas import legend_below, look, styled
from labctl.reports.pictures import png_of
from labctl.runs.format.origin import Origin
from labctl.runs.live.sight import Sight


@styled
def signals_png(sight: Sight, title: str, origin: Origin) -> bytes:
    """The figure as the bytes of a PNG, under a title that says when and of what it is; what is simulated is marked."""
    figure = Figure(figsize=(8.0, 6.0))
    ((levels, traces), (codes, frequencies)) = figure.subplots(2, 2)
    names = [port_name(port) for port in sight.ports]
    volts, places = sight.volts, np.arange(len(names))
    time_ns = 1e9 * sight.sample_interval_s * np.arange(volts.shape[2])
    counted = no_codes(len(names), sight.recent.dtype).with_more(sight.recent)
    found = spectrum(volts, sight.sample_interval_s) if volts.shape[2] >= LEAST_SAMPLES else None
    for row, _ in enumerate(names):
        style = {"color": look(row).colour, "linestyle": look(row).dashes, "linewidth": 1.0}
        traces.plot(time_ns, 1e3 * volts[-1, row], **style)
        codes.step(counted.first_code, counted.counts[row], where="post", **style)
        if found is not None:
            frequencies.plot(1e-9 * found.frequency_hz, 10 * np.log10(np.maximum(found.density[row], 1e-30)), **style)
    levels.barh(places, 1e3 * sight.now_v, color=[look(row).colour for row in range(len(names))])
    levels.plot(1e3 * sight.peak_v, places, "|", color="black", markersize=14)
    levels.set_yticks(places, names)
    levels.invert_yaxis()
    levels.set_xlabel("level, with the highest (mV)")
    traces.set_ylim(*(1e3 * end for end in sight.range_v))
    traces.set(xlabel="time (ns)", ylabel="signal (mV)")
    for end in (counted.first_code[0], counted.first_code[-1]):
        codes.axvline(end, color="red", linestyle="--", linewidth=0.8)
    codes.set(xlabel="code, clipped at the dashed lines", ylabel="samples")
    frequencies.set(xlabel="frequency (GHz)", ylabel="power density (dB of 1 V²/Hz)")
    figure.suptitle(title, fontsize=9)
    legend_below(figure, list(traces.lines), names)
    return png_of(figure, origin)
