"""The pages of sweeps: all of them, and one with its plot, which grows, and its runs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np
from nicegui import ui

from labctl.dashboard.frame import REFRESH_S, Region, frame, heading, refresh, show_missing
from labctl.dashboard.list_wording import run_address
from labctl.dashboard.monitor import Watching
from labctl.dashboard.resume_panel import ResumePanel
from labctl.dashboard.sketches import Axes, Line, escape, plot
from labctl.dashboard.sweep_accuracy import Recognition
from labctl.dashboard.sweeps import Point, SweepState
from labctl.dashboard.wording import nothing
from labctl.runs.format.store import is_elsewhere
from labctl.runs.sweep_axes import as_numbers

STYLES = "abcdef"
"""Of curves; more begin again."""


def show_sweeps(watching: Watching) -> None:
    """All sweeps."""
    frame(watching, "Sweeps")
    with ui.element("main"), ui.element("section"):
        heading("Sweeps")
        regions = [Region("sweeps", lambda: _sweeps(watching.sweeps.all()))]
    ui.timer(REFRESH_S, lambda: refresh(regions))


def show_sweep(watching: Watching, name: str) -> None:
    """One sweep, growing while it is measured."""
    state = watching.sweeps.named(name)
    if state is None:
        show_missing(watching, name)
        return
    first = next((point.row for point in state.points if point.row is not None), None)
    frame(watching, name, None if first is None else first.instruments)

    def now() -> SweepState:
        return watching.sweeps.named(name) or state

    def known() -> dict[str, Recognition]:
        found = {}
        for point in now().points:
            if point.row is not None and point.row.complete:
                directory = watching.folder / name / point.name
                one = watching.learning.recognition(directory, point.row.shots, growing=now().running)
                if one is not None:
                    found[point.name] = one
        return found

    with ui.element("main"):
        with ui.element("section"):
            heading("Accuracy of a softmax readout on the whole window, with its 95 % interval")
            regions = [Region("sweep-plot", lambda: sweep_plot(now(), known()))]
        with ui.element("section").classes("wide"):
            heading("Runs, in the order they are measured")
            regions.append(Region("points", lambda: _points(now(), known())))
            resume = ResumePanel(watching, watching.folder / name, lambda: _is_cut_short(watching.folder, now()))

    def look() -> None:
        refresh(regions)
        resume.refresh()

    ui.timer(REFRESH_S, look)


def _is_cut_short(folder: Path, state: SweepState) -> bool:
    """Whether runs are missing that nobody measures, and could be measured from here."""
    return not is_elsewhere(folder) and not state.running and state.complete < len(state.points)


def _sweeps(states: Sequence[SweepState]) -> str:
    if not states:
        return nothing("no sweeps: begin one by 'labctl sweep', or by 'Sweep over' in the form that starts a run")
    return f'<div class="runs sweeps">{"".join(map(_sweep, states))}</div>'


def _sweep(state: SweepState) -> str:
    if state.sweep is None:
        return f'<p class="problem">{escape(state.problem)}</p>'
    over = "; ".join(f"{axis}: {', '.join(values)}" for axis, values in state.sweep.over.items())
    how = "running" if state.running else "complete" if state.complete == len(state.points) else "incomplete"
    return (
        f'<a class="run sweep" href="sweep/{quote(state.name, safe="", errors="replace")}">'
        f'<span class="name">{escape(state.name)}</span><span class="over">{escape(over)}</span>'
        f'<span class="shots">{state.complete} of {len(state.points)} runs</span>'
        f'<span class="state {how}">{how}</span></a>'
    )


def _points(state: SweepState, known: Mapping[str, Recognition]) -> str:
    if not state.points:
        return nothing(state.problem)
    axes = list(state.points[0].values)
    head = "".join(f"<th>{escape(one)}</th>" for one in ("run", *axes, "shots", "accuracy", ""))
    rows = []
    for point in state.points:
        row, found = point.row, known.get(point.name)
        link = f'<a href="../{run_address(f"{state.name}/{point.name}")}">{escape(point.name)}</a>'
        values = "".join(f"<td>{escape(value)}</td>" for value in point.values.values())
        shots = "" if row is None else f"{row.shots} of {row.planned}"
        reached = (
            "" if found is None else f"{100 * found.accuracy:.1f} % [{100 * found.low:.1f}, {100 * found.high:.1f}]"
        )
        how = "waiting" if row is None else row.state
        rows.append(
            f"<tr><td>{escape(point.name) if row is None else link}</td>{values}<td>{escape(shots)}</td>"
            f'<td>{escape(reached)}</td><td class="state {how}">{how}</td></tr>'
        )
    return f'<table class="differing">{"<tr>" + head + "</tr>"}{"".join(rows)}</table>'


def sweep_plot(state: SweepState, known: Mapping[str, Recognition]) -> str:
    """Accuracy against the axis that has most values, a curve for each combination of the others."""
    measured = [point for point in state.points if point.name in known]
    if state.sweep is None or not measured:
        return nothing("no run is complete yet, its accuracy is still computed, or it has too few images for one")
    axes = state.sweep.over
    along = max(axes, key=lambda axis: len(axes[axis]))
    texts = axes[along]
    numbers, _ = as_numbers(texts)
    at: dict[str, float] = dict(zip(texts, range(len(texts)) if numbers is None else numbers, strict=True))
    curves: dict[str, list[Point]] = {}
    for point in measured:
        others = ", ".join(f"{axis} {point.values[axis]}" for axis in axes if axis != along)
        curves.setdefault(others or along, []).append(point)
    lines, legend = [], ""
    chance = known[measured[0].name].chance
    low, high = min(at.values()), max(at.values())
    room = 0.03 * (high - low or 1.0)
    lines.append(Line(np.array([low - room, high + room]), np.array([chance, chance]), "chance"))
    for number, (label, found) in enumerate(sorted(curves.items())):
        style = STYLES[number % len(STYLES)]
        found = sorted(found, key=lambda point: at[point.values[along]])
        x = np.array([at[point.values[along]] for point in found])
        lines.append(Line(x, np.array([known[point.name].accuracy for point in found]), style, dots=True))
        for place, point in zip(x, found, strict=True):
            one = known[point.name]
            lines.append(Line(np.array([place, place]), np.array([one.low, one.high]), style))
        legend += f'<span class="{style}">{escape(label)}</span>'
    title = f"accuracy against {along}, {len(measured)} of {len(state.points)} runs"
    ends = min(texts, key=at.__getitem__), max(texts, key=at.__getitem__)
    drawn = plot(title, lines, Axes((low - room, high + room), (0.0, 1.0), ends, ("0 %", "100 %")))
    return f'{drawn}<p class="legend">{legend}</p>'
