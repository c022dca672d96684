"""The page of two runs: what differs in settings, the same picture as both measured it, accuracy over accuracy."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from nicegui import ui

from labctl.dashboard import wording
from labctl.dashboard.frame import REFRESH_S, Region, frame, heading, refresh, show_missing
from labctl.dashboard.monitor import WatchedRun, Watching
from labctl.dashboard.sketches import escape
from labctl.runs.format.manifest import inputs_source, protocol_settings
from labctl.runs.index import origin_of
from labctl.runs.read.differences import settings_that_differ
from labctl.runs.read.follower import Latest

MOST_PICTURES = 500
"""To choose from."""


def show_comparison(watching: Watching, one: str, other: str) -> None:
    """Two runs side by side."""
    first, second = watching.run(one), watching.run(other)
    if first is None or second is None:
        show_missing(watching, one if first is None else other)
        return
    for watched in (first, second):
        watched.look()
    frame(watching, "Two runs", origin_of(first.manifest), origin_of(second.manifest))
    with ui.element("main").classes("comparison"):
        with ui.element("section").classes("wide"):
            heading("Settings that differ")
            unread = [watched.problem for watched in (first, second) if not watched.manifest]
            for problem in unread:
                ui.html(f'<p class="problem">{escape(problem)}</p>', sanitize=False)
            if not unread:
                found = settings_that_differ(first.manifest, second.manifest, watching.sent_anew)
                ui.html(wording.differing(found, one, other), sanitize=False)
        with ui.element("section").classes("wide traces"):
            heading("The same picture, as both measured it")
            legend = "".join(
                f'<span class="{style}">{escape(name)}</span>' for style, name in (("a", one), ("b", other))
            )
            ui.html(f'<p class="legend">{legend}</p>', sanitize=False)
            regions = [_show_picture(first, second)]
        with ui.element("section").classes("wide"):
            heading("Accuracy as it grows")
            regions.append(Region("accuracy", lambda: wording.accuracy(first.curve(), second.curve())))

    def look() -> None:
        for watched in (first, second):
            watched.look()
        refresh(regions)

    ui.timer(REFRESH_S, look)


def _show_picture(first: WatchedRun, second: WatchedRun) -> Region:
    """A picture to choose, and its traces over each other."""
    common = common_pictures(first, second)
    names = {place: f"image {place}" + (f", class {label}" if label >= 0 else "") for place, label in common.items()}
    chosen = ui.select(names, value=next(iter(names), None), label="Picture", with_input=True).classes("same-picture")
    chosen.set_visibility(bool(names))

    def traces() -> str:
        if chosen.value is None:
            return wording.nothing(
                "no picture that both runs measured: they show other data sets, or other images of it"
            )
        here, there = (watched.shot(watched.pictures[chosen.value][1]) for watched in (first, second))
        apart = ", ".join(f"port {port}: {100 * part:.0f} %" for port, part in difference(here, there).items())
        words = (
            f"{names[chosen.value]}; difference (rms, of the first): {apart}"
            if apart
            else "no port in common that was sampled alike"
        )
        return wording.nothing(words) + wording.traces(here, there)

    region = Region("ports", traces)
    chosen.on_value_change(region.refresh)
    return region


def common_pictures(first: WatchedRun, second: WatchedRun) -> dict[int, int]:
    """Places in the data set of the pictures that both runs measured, and their classes."""
    shown = _shown_as(first.manifest)
    if shown is None or shown != _shown_as(second.manifest):
        return {}
    theirs = second.pictures
    found = [(place, label) for place, (label, _) in first.pictures.items() if place in theirs]
    return dict(found[:MOST_PICTURES])


def _shown_as(manifest: Mapping[str, Any]) -> tuple[str, object] | None:
    """What makes images of two runs the same by their index; None where nobody says."""
    source = inputs_source(manifest)
    return None if source is None else (source, protocol_settings(manifest).get("binarisation"))


def difference(here: list[Latest], there: list[Latest]) -> dict[int, float]:
    """How far apart two records are on each port that both have: rms of the difference, of the rms of the first.

    Where one is longer, as far as both go; of several wavelengths, at the last one. Records of other sample intervals
    have no samples to compare.
    """
    theirs = {
        (port, one.wavelength_nm, one.sample_interval_s): volts
        for one in there
        for port, volts in zip(one.ports, one.volts, strict=True)
    }
    found = {}
    for one in here:
        for port, volts in zip(one.ports, one.volts, strict=True):
            other = theirs.get((port, one.wavelength_nm, one.sample_interval_s))
            if other is not None:
                samples = min(volts.size, other.size)
                size = float(np.sqrt(np.mean(volts[:samples] ** 2)))
                found[port] = float(np.sqrt(np.mean((volts[:samples] - other[:samples]) ** 2))) / (size or 1.0)
    return found
