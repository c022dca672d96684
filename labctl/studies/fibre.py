"""From a run of `wavelength-scan` to what it says of the fibre: numbers, figure, report."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from labctl.analysis.decorrelation import (
    Decorrelation,
    Launch,
    Scan,
    crossing,
    decorrelation,
    delay_spread_s,
    frequency_hz,
)
from labctl.analysis.windows import WAVELENGTH_TOLERANCE_NM
from labctl.errors import AnalysisError
from labctl.reports.decorrelation import decorrelation_report
from labctl.runs.read.records import read_records
from labctl.runs.read.run import Run, open_run

LAUNCHES: dict[Launch, str] = {
    "gaussian": "launched by a single-mode lead (Gaussian, NA at 1/e²)",
    "filled": "launched evenly up to NA",
}
QUANTITY = "correlation of intensities over time, each trace about its mean, noise taken off, 1 = same wavelength"
LONG_ENOUGH = 4.0
"""How many half widths a scan is asked to span where one was too short."""


def read_scan(run: Run) -> Scan:
    """The images of a run at its wavelengths, on the grid that starts at the trigger.

    Raises:
        AnalysisError: The run holds no images, or not at evenly spaced wavelengths.
    """
    images = read_records(run)
    of_row = np.asarray(run.shape.wavelength_of_port)
    order = np.argsort(of_row, kind="stable")
    first = np.flatnonzero(np.diff(of_row[order], prepend=-np.inf) > WAVELENGTH_TOLERANCE_NM)
    wavelengths = of_row[order][first]
    steps = np.diff(wavelengths)
    if not steps.size or np.ptp(steps) > WAVELENGTH_TOLERANCE_NM or of_row.size % wavelengths.size:
        raise AnalysisError(
            f"{run.path}: not measured at evenly spaced wavelengths: 'labctl run wavelength-scan' measures at such"
        )
    rows = order.reshape(wavelengths.size, -1)
    again = np.flatnonzero(run.shots["kind"] == "reference")
    repeats = np.zeros((0, *images.traces.shape[1:]))
    if again.size:
        repeated = read_records(run, "reference")
        place = {int(group): position for position, group in enumerate(images.groups)}
        shown = [(one, place[int(group)]) for one, group in enumerate(repeated.groups) if int(group) in place]
        repeats = np.array([repeated.traces[one] - images.traces[other] for one, other in shown] or repeats)
    return Scan(
        traces=np.moveaxis(images.traces[:, rows], 0, 1),
        repeats=np.moveaxis(repeats[:, rows], 0, 1),
        centre_nm=float(wavelengths.mean()),
        step_nm=round(float(steps.mean()), 9),
        symbol_s=0.0 if run.drive is None else 1 / run.drive.sample_rate,
        ports=tuple(run.ports[row] for row in rows[0]),
    )


def measure_fibre(directory: Path) -> dict[str, Any]:
    """Correlation against detuning, half width, delay spread; writes figure and report of the run.

    Raises:
        AnalysisError: the run is no scan, or holds no light.
        RunError: no such run.
    """
    with open_run(directory) as run:
        scan, manifest = read_scan(run), run.manifest
    found = decorrelation(scan)
    result: dict[str, Any] = {
        "run": str(directory),
        "protocol": manifest["protocol"]["name"],
        "quantity": QUANTITY,
        "images": found.images,
        "ports": list(scan.ports),
        "centre_nm": scan.centre_nm,
        "step_nm": scan.step_nm,
        "scanned_nm": float(found.detuning_nm[-1]),
        "verdict": found.verdict,
        "half_width_nm": found.half_width_nm,
        "half_width_uncertainty_nm": found.uncertainty_nm,
        "half_width_hz": found.half_width_nm and frequency_hz(found.half_width_nm, scan.centre_nm),
        "delay_spread_s": _delay_spreads(scan, found),
        "what_to_do": _what_to_do(scan, found),
        "likeness_of_images": found.likeness,
        "detuning_nm": found.detuning_nm.tolist(),
        "correlation": found.correlation.tolist(),
    }
    report = decorrelation_report(directory, scan, found, lines=in_words(result), manifest=manifest)
    return result | {"report": str(report)}


def in_words(result: dict[str, Any]) -> list[str]:
    """The result in a few sentences, units included."""
    first = result["centre_nm"] - result["scanned_nm"] / 2
    lines = [
        f"intensity correlation of {result['images']} images on port {', '.join(map(str, result['ports']))}, "
        f"{first:.8g} nm to {first + result['scanned_nm']:.8g} nm in steps of {_length(result['step_nm'])}"
    ]
    if result["half_width_nm"] is None:
        return [*lines, f"half width at half maximum: not known, the scan is {result['what_to_do']}"]
    spread = result["half_width_uncertainty_nm"]
    width = _length(result["half_width_nm"], spread)
    lines.append(f"half width at half maximum: {width} ({result['half_width_hz'] / 1e9:.3g} GHz)")
    if spread is None:
        lines.append("its uncertainty is not known: without one of the images it is not reached; show more images")
    if any(result["ports"]):
        lines.append("behind the chip, whose resonances change with the wavelength too: port 0 shows the fibre alone")
    for launch, words in LAUNCHES.items():
        delay = result["delay_spread_s"] and result["delay_spread_s"][launch]
        if delay:
            mean, sd = (value and 1e9 * value for value in (delay["mean"], delay["sd"]))
            known = f"{mean:.2g}" if sd is None else _with_spread(mean, sd)
            lines.append(f"delay spread L NA²/(2 n c) of the modes that the images light: {known} ns if {words}")
    return lines


def _delay_spreads(scan: Scan, found: Decorrelation) -> dict[str, Any] | None:
    """Delay spread by the way of launching; None where the scan does not show it, or sees more than the fibre."""
    if found.half_width_nm is None or any(scan.ports):
        return None
    spreads: dict[str, Any] = {}
    for launch in LAUNCHES:
        spread = delay_spread_s(
            frequency_hz(found.half_width_nm, scan.centre_nm), launch=launch, symbol_s=scan.symbol_s
        )
        sd = None
        if spread is not None and found.uncertainty_nm is not None:
            sd = spread * found.uncertainty_nm / found.half_width_nm
        spreads[launch] = None if spread is None else {"mean": spread, "sd": sd}
    return spreads


def _what_to_do(scan: Scan, found: Decorrelation) -> str | None:
    if found.verdict == "measured":
        return None
    if found.verdict == "too coarse":
        return (
            f"too coarse: less than one half is left after one step of {_length(scan.step_nm)}; "
            f"measure again with --set step='{scan.step_nm / 4:.3g} nm'"
        )
    scanned = float(found.detuning_nm[-1])
    reached = crossing(found.detuning_nm, found.correlation)
    steps = 1 + round(LONG_ENOUGH * (scanned if reached is None else reached) / scan.step_nm)
    seen = "stays above one half" if reached is None else f"falls to one half only {_length(reached)} away"
    return (
        f"too short: the correlation {seen}, the scan spans {_length(scanned)}; measure again with --set steps={steps}"
    )


def _length(nm: float, sd: float | None = None) -> str:
    factor, unit = (1e3, "pm") if nm < 0.5 else (1.0, "nm")
    return f"{factor * nm:.3g} {unit}" if sd is None else f"{_with_spread(factor * nm, factor * sd)} {unit}"


def _with_spread(value: float, sd: float) -> str:
    """Both to the first digit of the spread that counts: 6.3 ± 0.8."""
    decimals = max(0, -math.floor(math.log10(sd)))
    return f"{value:.{decimals}f} ± {sd:.{decimals}f}"
