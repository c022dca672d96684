"""The page of all runs: those that are running, and a list to search, with columns and an order to choose."""

import json
from dataclasses import replace

from nicegui import ui

from labctl.dashboard import wording
from labctl.dashboard.frame import REFRESH_S, Region, frame, heading, refresh, say_elsewhere
from labctl.dashboard.list_wording import run_list
from labctl.dashboard.listing import MOST_COLUMNS, SHOWN, Wanted
from labctl.dashboard.monitor import Watching
from labctl.runs.format.store import is_elsewhere

EXAMPLE = "words, or: images >= 300 and tag = good"


def show_list(watching: Watching, wanted: Wanted) -> None:
    """All runs, those that are running first; what is wanted stands in the address, to be kept and gone back to."""
    frame(watching, f"Runs in {watching.folder}")

    def live() -> str:
        found = [(name, watched) for name in watching.running() if (watched := watching.run(name)) is not None]
        for _, watched in found:
            watched.look()
        return wording.live(found)

    with ui.element("main").classes("list"):
        regions = []
        if is_elsewhere(watching.folder):
            with ui.element("section"):
                say_elsewhere(
                    watching.folder, f"it is shown as it was at {watching.listed:%H:%M:%S} UTC; reload for news"
                )
        else:
            with ui.element("section"):
                heading("Running")
                regions.append(Region("live", live))
        with ui.element("section"):
            heading("Runs")
            regions.append(_show_search(watching, wanted))
    ui.timer(REFRESH_S, lambda: refresh(regions))


def _show_search(watching: Watching, wanted: Wanted) -> Region:
    """The list, what it is searched by, and the way to more of it."""
    listing = watching.listing
    with ui.element("div").classes("search"):
        words = ui.input("Search", value=wanted.words, placeholder=EXAMPLE).classes("filter")
        keys = sorted({*listing.keys(), *wanted.columns})
        columns = ui.select(keys, label="Columns", multiple=True, value=list(wanted.columns)).props("dense")
        columns.props(f"use-chips max-values={MOST_COLUMNS}").classes("columns")
    most = SHOWN

    def now() -> Wanted:
        return replace(wanted, words=words.value or "", columns=tuple(columns.value or ()), most=most)

    region = Region("all", lambda: run_list(listing.runs(now())))
    more = ui.button("Show more", color=None).classes("more").props("flat")

    def draw() -> None:
        region.refresh()
        more.set_visibility(listing.runs(now()).total > most)

    def changed() -> None:
        ui.run_javascript(f"history.replaceState(null, '', location.pathname + {json.dumps('?' + now().address)})")
        draw()

    def show_more() -> None:
        nonlocal most
        most += SHOWN
        draw()

    words.on_value_change(changed)
    columns.on_value_change(changed)
    more.on_click(show_more)
    draw()
    return region
