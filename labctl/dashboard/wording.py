"""What the pages say, as HTML: all text from runs is escaped here, and nowhere else is HTML made of it."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.dashboard import sketches
from labctl.dashboard.accuracy import LEAST, Curve
from labctl.dashboard.following import BLOCK, LAST, Following
from labctl.dashboard.list_wording import run_address
from labctl.dashboard.monitor import Alarm, WatchedRun
from labctl.dashboard.sketches import Line, escape
from labctl.dashboard.state import ENDED, Emission, Phase, RunState, number_in, text_in
from labctl.runs.format.origin import Origin
from labctl.runs.read.differences import Difference
from labctl.runs.read.follower import Latest

MOST_PLOTS = 16
"""Of traces: where more were measured, as in a wavelength scan, the last ones."""
MAY_EMIT = "LASER MAY STILL EMIT"
MOST_DIFFERENCES = 200
MOST_INSTRUMENTS = 20
NAMES = {
    "awg": "AWG",
    "dmd": "DMD",
    "scope": "oscilloscope",
    "patch_panel": "patch panel",
    "power_meter": "power meter",
}
"""Of instruments that are not called as their role is."""


def emission(state: RunState) -> str:
    """Laser emission, large: the first thing to be seen on the page."""
    light = "" if state.wavelength_nm is None else f"{state.wavelength_nm:.3f} nm"
    power = "" if state.power_w is None else _milliwatts(state.power_w)
    words = {
        Emission.ON: ("LASER ON", " · ".join(filter(None, (light, power)))),
        Emission.OFF: ("LASER OFF", "the bench is dark"),
        Emission.UNKNOWN: ("LASER UNKNOWN", "take it for on: look at the laser itself"),
    }
    if state.phase is Phase.UNKNOWN:
        words[Emission.UNKNOWN] = ("NO EVENTS", "this run reports nothing about its light")
    word, explanation = words[state.emission]
    style = "none" if state.phase is Phase.UNKNOWN else str(state.emission)
    if state.alarm:
        word, explanation, style = MAY_EMIT, "it did not go dark: switch it off by its key switch", "on"
    return _light(word, explanation, style, simulated=state.simulated and not state.mixed)


def _light(word: str, explanation: str, style: str, *, simulated: bool) -> str:
    if simulated:
        word, style = f"SIMULATED {word}", f"{style} simulated"
    return f'<div class="emission {style}"><strong>{word}</strong><span>{escape(explanation)}</span></div>'


def progress(state: RunState, records: tuple[int, int]) -> str:
    """How far the run is, how fast, and how long it takes still; when it has ended, what it has on disk counts."""
    told = bool(state.total) and (state.running or not records[1])
    done, total = (state.done, state.total) if told else records
    phase, style = str(state.phase), state.phase.name.lower()
    if state.phase is Phase.FINISHED and records[0] < records[1]:  # it was whole once: its journal was cut
        phase = style = "incomplete"
    part = 100 * done / total if total else 0.0
    one = "" if state.pass_index is None or not state.passes else f"pass {state.pass_index + 1} of {state.passes}"
    rate = "" if state.rate_per_s is None else f"{state.rate_per_s:.0f} records/s"
    left = "" if state.remaining_s is None else f"{duration(state.remaining_s)} left"
    partly = f"{state.station}: MIXED, some instruments are simulated" if state.mixed else "simulated bench"
    bench = "" if not state.station else partly if state.simulated else state.station
    details = " · ".join(filter(None, (f"{done} of {total} records", rate, left, one, state.uploading, bench)))
    return (
        f'<div class="progress"><div class="line"><strong class="phase {style}">'
        f"{escape(phase)}</strong><span>{escape(details)}</span></div>"
        f'<div class="bar" role="progressbar" aria-valuenow="{part:.0f}">'
        f'<div style="width:{part:.2f}%"></div></div></div>'
    )


def instruments(state: RunState, manifest: Mapping[str, Any]) -> str:
    """Every instrument with what is known of its state, and by the manifest who and where it is."""
    ended = state.phase in ENDED
    ports = ", ".join(f"{channel} ← port {port}" for channel, port in state.patching)
    shown = "" if state.shot is None else f"{state.kind} of shot {state.shot}"
    blank = state.image is None and (state.drive is False or ended)
    found, station = _tables(manifest.get("instruments")), _tables(manifest.get("station"))
    doing = {
        "laser": {Emission.ON: "emits", Emission.OFF: "dark", Emission.UNKNOWN: "not known"}[state.emission],
        "awg": {None: "not known yet", True: "plays the drive", False: "output off"}[state.drive],
        "dmd": "blank" if blank else shown or "not known yet",
        "scope": state.scope or "not known yet",
        "patch_panel": ports or "not known yet",
    } | {name: words(state, station.get(name, {})) for name, words in BEHIND.items() if name in found}
    names = [*doing, *(name for name in found if name not in doing)][:MOST_INSTRUMENTS]
    body = "".join(
        f"<dt>{escape(NAMES.get(name, name))}</dt><dd>{escape(doing.get(name, ''))}"
        f"<small>{escape(_who(found.get(name, {}), station.get(name, {})))}</small></dd>"
        for name in names
    )
    return f'<dl class="instruments">{body}</dl>'


def _who(found: Mapping[str, Any], section: Mapping[str, Any]) -> str:
    """Maker, model, serial number and address of an instrument, as far as the manifest has them."""
    identity = _tables(found).get("identity", {})
    who = " ".join(filter(None, (text_in(identity, name) for name in ("manufacturer", "model", "serial"))))
    return " at ".join(filter(None, (who, text_in(section, "address"))))


def _tables(value: object) -> dict[str, dict[str, Any]]:
    """What of a manifest are tables by name; it may be a stranger's, and anything else counts as absent."""
    return {name: table for name, table in value.items() if isinstance(table, dict)} if isinstance(value, dict) else {}


def _meter(state: RunState, section: Mapping[str, Any]) -> str:
    read = "not read yet" if state.measured_w is None else f"saw the laser give {_milliwatts(state.measured_w)}"
    tap = number_in(section, "tap")
    return read + ("" if tap is None else f", tap {100 * tap:g} %")


def _amplifier(state: RunState, section: Mapping[str, Any]) -> str:
    gives = "" if state.amplified_w is None else f", gives {_milliwatts(state.amplified_w)}"
    power_w = number_in(section, "power")
    set_to = "" if power_w is None else f", set to {_milliwatts(power_w)}"
    return {None: "not known", True: f"on{gives}", False: "off"}[state.through] + set_to


def _attenuator(state: RunState, section: Mapping[str, Any]) -> str:
    gives = "" if state.attenuation_db is None else f", {state.attenuation_db:g} dB"
    attenuation_db = number_in(section, "attenuation_db")
    set_to = "" if attenuation_db is None else f", set to {attenuation_db:g} dB"
    return {None: "not known", True: f"open{gives}", False: "shut"}[state.through] + set_to


def _milliwatts(power_w: float) -> str:
    return f"{power_w * 1e3:.3g} mW"


BEHIND = {"attenuator": _attenuator, "amplifier": _amplifier, "power_meter": _meter}
"""What is said of the instruments behind the laser, where a bench has them."""


def nothing(words: str) -> str:
    """Quiet words, mostly in place of something that is not there."""
    return f'<p class="nothing">{escape(words)}</p>'


def image(state: RunState) -> str:
    """The picture of the shot that was reported."""
    if state.image is None:
        return '<p class="nothing">its picture was not reported</p>'
    label = "" if state.label is None or state.label < 0 else f"class {state.label}"
    source = "" if state.dataset_index is None else f"image {state.dataset_index}"
    kind = f"{state.kind}: " if state.kind != "image" and source else ""
    caption = kind + ", ".join(filter(None, (source, label)))
    return f'{sketches.picture(state.image)}<p class="caption">{escape(caption)}</p>'


def traces(latest: Sequence[Latest], other: Sequence[Latest] = ()) -> str:
    """A shot on every port, from end to end of what the oscilloscope can tell; those of two runs over each other."""
    if not latest:
        return '<p class="nothing">no shot on disk yet</p>'
    theirs = {
        (port, one.wavelength_nm): (Line(_time(one), volts, "b"), ends)
        for one in other
        for port, volts, ends in zip(one.ports, one.volts, one.ends, strict=True)
    }
    several = len({one.wavelength_nm for one in latest}) > 1
    names, lines, scales = [], [], []
    for one in latest:
        for port, volts, ends in zip(one.ports, one.volts, one.ends, strict=True):
            light = f", {one.wavelength_nm:.3f} nm" if several else ""
            names.append(f"port {port}{light}" + ("" if other else f" · {one.kind} {one.shot}"))
            drawn = [Line(_time(one), volts, "a")]
            if (found := theirs.get((port, one.wavelength_nm))) is not None:
                line, other_ends = found
                drawn.append(line)
                ends = np.concatenate([ends, other_ends])
            lines.append(drawn)
            scales.append((float(ends.min()), float(ends.max())))
    longest = max((line.x for drawn in lines for line in drawn), key=lambda time_s: time_s[-1])
    return sketches.traces(names[-MOST_PLOTS:], longest, lines[-MOST_PLOTS:], scales[-MOST_PLOTS:])


def _time(latest: Latest) -> NDArray[np.floating]:
    return np.arange(latest.volts.shape[1]) * latest.sample_interval_s


def accuracy(curve: Curve, other: Curve | None = None) -> str:
    """Accuracy as it grows, of one run or of two over each other."""
    curves = [curve] if other is None else [curve, other]
    if not any(one.images for one in curves):
        return '<p class="nothing">no accuracy yet: it takes some images of more than one class</p>'
    title = "; ".join(_reached(one) for one in curves)
    return sketches.accuracy(title, [(one.images, one.accuracy) for one in curves], curve.chance)


def following(found: Following, chance: float | None) -> str:
    """How a readout that follows the run fares: its last images, all of them, and block by block."""
    images, reached = found.points
    if not images.size:
        return f'<p class="nothing">nothing yet: it takes {LEAST + BLOCK} images of more than one class</p>'
    last = found.right[-LAST:]
    ports = ", ".join(map(str, found.ports))
    title = (
        f"{100 * last.mean():.1f} % of the last {last.size} images, {100 * found.right.mean():.1f} % of all "
        f"{found.right.size} since the first {LEAST}, ports {ports}"
    )
    return sketches.accuracy(title, [(images.tolist(), reached.tolist())], chance)


def _reached(curve: Curve) -> str:
    if not curve.images:
        return "no accuracy yet"
    ports = ", ".join(map(str, curve.ports))
    return f"{100 * curve.accuracy[-1]:.1f} % after {curve.images[-1]} images, ports {ports}"


def log(state: RunState, problem: str = "") -> str:
    """What the run reported, the last line first."""
    if problem:
        return f'<p class="problem">{escape(problem)}</p>' + log(state)
    lines = "".join(
        f'<li class="{"alarm" if line.alarming else "plain"}"><time>{escape(line.time[11:19])}</time>'
        f"{escape(line.text)}</li>"
        for line in reversed(state.log)
    )
    return f'<ol class="log">{lines}</ol>' if lines else '<p class="nothing">no events</p>'


def live(runs: Iterable[tuple[str, WatchedRun]]) -> str:
    """A strip for every run that is running."""
    strips = "".join(
        f'<a class="live" href="{run_address(name)}"><span class="name">{escape(name)}</span>'
        f"{emission(watched.state)}{progress(watched.state, watched.records)}</a>"
        for name, watched in runs
    )
    return strips or '<p class="nothing">no run is running</p>'


def alarm(found: Alarm) -> str:
    """A banner for a laser that did not go dark."""
    explanation = f"{found.name}: switch it off by its key switch"
    return _light(MAY_EMIT, explanation, "on", simulated=found.origin is Origin.SIMULATED)


def differing(found: Sequence[Difference], one: str, other: str) -> str:
    """A table of the settings that differ."""
    if not found:
        return '<p class="nothing">no setting differs</p>'
    rows = "".join(
        f"<tr><th>{escape(each.setting)}</th><td>{escape(_value(each.then))}</td>"
        f"<td>{escape(_value(each.now))}</td></tr>"
        for each in found[:MOST_DIFFERENCES]
    )
    head = f'<tr><th></th><th class="a">{escape(one)}</th><th class="b">{escape(other)}</th></tr>'
    return f'<div class="wide"><table class="differing">{head}{rows}</table></div>'


def _value(value: object) -> str:
    text = "not there" if value is None else str(value)
    return text if len(text) <= 120 else f"{text[:120]}..."


def duration(seconds: float) -> str:
    """So long, in words for people."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
