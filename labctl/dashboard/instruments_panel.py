"""What was set on each instrument of a run, what it read back, and what was said to it last."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from nicegui import ui

from labctl.dashboard.frame import Region
from labctl.dashboard.monitor import WatchedRun
from labctl.dashboard.sketches import escape
from labctl.dashboard.wording import NAMES, nothing
from labctl.runs.format.layout import RunPaths
from labctl.runs.live.messages import last_messages

MOST_INSTRUMENTS, MOST_SETTINGS, MOST_MESSAGES = 20, 200, 40
LONGEST = 300
OF_ALL = "run"
"""Whose lines say that what was said before was said again, or what went wrong."""


def show_instruments(watched: WatchedRun) -> list[Region]:
    """A part to open for each instrument that the manifest names; what is shut is not read."""
    found = watched.manifest.get("instruments")
    names = [str(name) for name in found][:MOST_INSTRUMENTS] if isinstance(found, dict) else []
    if not names:
        ui.html(nothing("the manifest names no instrument"), sanitize=False)
    regions = []
    for name in names:
        with ui.expansion(NAMES.get(name, name)).classes(f"instrument {name}") as part:
            regions.append(Region("instrument", partial(_opened, part, watched, name)))
        part.on_value_change(regions[-1].refresh)
    return regions


def _opened(part: ui.expansion, watched: WatchedRun, name: str) -> str:
    return panel(watched, name) if part.value else ""


def panel(watched: WatchedRun, name: str) -> str:
    """An instrument by manifest and log."""
    manifest = watched.manifest
    instrument = _table(_table(manifest, "instruments"), name)
    log = last_messages(RunPaths(watched.directory).commands)
    messages = [one for one in log if one.instrument in (name, OF_ALL)]
    said = "".join(
        f"<li><time>{escape(one.time_s)}</time>{escape(one.sign)} {escape(one.text[:LONGEST])}</li>"
        for one in reversed(messages[-MOST_MESSAGES:])
    )
    return (
        f'<div class="set-and-read">{_settings("set, by the station file", _table(_table(manifest, "station"), name))}'
        f"{_settings('read back before the first shot', _table(instrument, 'settings'))}</div>"
        f"<h3>last messages</h3>" + (f'<ol class="messages">{said}</ol>' if said else nothing("none in the log's end"))
    )


def _settings(title: str, values: Mapping[str, Any]) -> str:
    rows = "".join(
        f"<tr><th>{escape(str(key)[:LONGEST])}</th><td>{escape(str(value)[:LONGEST])}</td></tr>"
        for key, value in list(values.items())[:MOST_SETTINGS]
        if value is not None
    )
    return f'<div><h3>{escape(title)}</h3><table class="differing">{rows}</table></div>'


def _table(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """A table of a manifest; a stranger's may hold anything there."""
    found = values.get(name)
    return found if isinstance(found, dict) else {}
