"""The page that starts a run or sweep, or queues it: a form made from the schema of the protocol's settings."""

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import background_tasks, ui

from labctl import datasets
from labctl.dashboard import launcher
from labctl.dashboard.commands import answer
from labctl.dashboard.frame import frame, heading
from labctl.dashboard.launcher import Asked
from labctl.dashboard.monitor import Watching
from labctl.dashboard.settings_fields import Setting, about, refused, settings_of
from labctl.dashboard.starting import begin
from labctl.dashboard.wording import duration
from labctl.runs.format.layout import RunPaths
from labctl.runs.sweep import is_sweep

TYPED_MS = 500
"""After the last key that was pressed, what is asked for is checked."""
DATASET = "dataset"
"""The setting that names a data set, in every protocol that has one."""

Field = ui.input | ui.select


def show_start(watching: Watching) -> None:
    """The form of a run."""
    frame(watching, "Start a run")
    with ui.element("main"), ui.element("section"):
        heading("Start a run")
        Form(watching)


class Form:
    """What is asked for, field by field, what it costs, and the buttons that have it done.

    Whatever is typed is asked of `labctl run --dry-run`: what that refuses is marked before anything is started.
    """

    def __init__(self, watching: Watching) -> None:
        """For the runs of a folder."""
        self._watching = watching
        self._fields: dict[str, tuple[Setting, Field]] = {}
        self._checking: asyncio.Task[Any] | None = None
        with ui.element("div").classes("form"):
            names = launcher.protocols()
            usual = launcher.USUAL if launcher.USUAL in names else names[0]
            self._protocol = ui.select(names, value=usual, label="Protocol").classes("protocol")
            self._station = ui.input("Station file", placeholder="empty: the simulated bench").classes("station")
            self._about = ui.label().classes("about")
            self._settings = ui.element("div").classes("settings")
            self._over = ui.textarea("Sweep over", placeholder="window=0.4 ns,1 ns\npower=10:30:5 mW").classes("over")
            self._over.props("rows=2 stack-label hint='an axis a line; empty: one run'")
            self._cost = ui.label().classes("cost")
            self._attended = ui.checkbox("somebody stands at the laser's key switch (--attended)")
            with ui.element("div").classes("arm"):
                self._armed = ui.switch("light may be switched on (--arm)").classes("armed")
                ui.button("Start", on_click=self._start, color=None).classes("start")
                ui.button("Add to the queue", on_click=self._queue, color=None).classes("start queue-add")
            self._message = ui.label().classes("message")
        for element in (self._station, self._over):
            element.props(f"debounce={TYPED_MS}")
        self._protocol.on_value_change(self._show_settings)
        for changed in (self._station, self._over, self._attended):
            changed.on_value_change(self._check)
        ui.timer(0, self._show_settings, once=True)

    def _asked(self, *, armed: bool = False) -> Asked:
        typed = {name: str(field.value or "").strip() for name, (_, field) in self._fields.items()}
        return Asked(
            str(self._protocol.value),
            {name: text for name, text in typed.items() if text not in ("", self._fields[name][0].usual)},
            tuple(filter(None, map(str.strip, (self._over.value or "").splitlines()))),
            (self._station.value or "").strip(),
            armed=armed,
            attended=bool(self._attended.value),
        )

    async def _show_settings(self) -> None:
        """A field for each setting of the protocol."""
        self._fields = {}
        self._settings.clear()
        self._about.set_text("")
        self._cost.set_text("reading the settings ...")
        schema = await answer(["schema", str(self._protocol.value)], self._watching.environment)
        if "properties" not in schema:
            self._cost.set_text(str(schema.get("error", "")))
            return
        self._about.set_text(about(schema))
        with self._settings:
            for setting in settings_of(schema):
                self._fields[setting.name] = setting, self._field(setting)
        self._check()

    def _field(self, setting: Setting) -> Field:
        choices = _datasets(setting.usual) if setting.name == DATASET else setting.choices
        field: Field
        if choices:
            field = ui.select(list(choices), label=setting.name, value=setting.usual)
        else:
            field = ui.input(setting.name, placeholder=setting.usual or "not set")
        field.props(f"debounce={TYPED_MS} stack-label hint={_quoted(setting.hint)}").classes(f"set-{setting.name}")
        field.on_value_change(self._check)
        return field

    def _check(self) -> None:
        if self._checking is not None:
            self._checking.cancel()
        self._checking = background_tasks.create(self._checked(), name="what a run would cost")

    async def _checked(self) -> None:
        found = await answer([*self._asked().words, "--dry-run"], self._watching.environment)
        name, why = refused(str(found["error"])) if "error" in found else ("", "")
        for known, (_, field) in self._fields.items():
            field.error = why if known == name else None
        self._cost.classes(replace="cost refused" if "error" in found else "cost")
        self._cost.set_text(why if not name and why else f"{name}: {why}" if why else cost(found))

    async def _queue(self) -> None:
        asked = self._asked(armed=bool(self._armed.value))
        self._armed.set_value(False)
        self._message.set_text("adding ...")
        words = ["queue", "add", "--folder", str(self._watching.folder.resolve()), "--json", *asked.words]
        found = await answer(words, self._watching.environment)
        self._message.set_text(str(found.get("error") or f"number {found['number']} of the queue"))

    async def _start(self) -> None:
        asked = self._asked(armed=bool(self._armed.value))
        directory = launcher.new_directory(self._watching.folder, asked)

        def leads_to() -> str:
            self._watching.listing.look_again()
            if asked.over:
                return f"/sweep/{directory.name}" if is_sweep(directory) else ""
            return f"/run/{directory.name}" if RunPaths(directory).manifest.exists() else ""

        words = [*asked.words, f"--out={directory}"]
        self._armed.set_value(False)
        await begin(words, self._watching, self._message, leads_to, asked.station)


def cost(plan: Mapping[str, Any]) -> str:
    """What a run or sweep will take, in one line."""
    power_w = plan.get("laser_power_w")
    parts = [
        f"{plan['runs']} runs" if "runs" in plan else "",
        f"{plan['shots']} shots" + (f" in {plan['passes']} passes" if plan.get("passes", 1) > 1 else ""),
        f"{duration(plan['estimated_seconds_on_a_real_bench'])} on a real bench",
        f"{plan['dose_j']:.3g} J of light at most" + ("" if power_w is None else f" ({1e3 * power_w:g} mW)"),
        f"{1e-6 * plan['bytes_needed']:.1f} MB on disk",
        str(plan.get("aliasing", "")),
    ]
    return " · ".join(filter(None, parts))


def _datasets(usual: str) -> Sequence[str]:
    """Names of the data sets that can stand in place of the usual one: those of its kind."""
    cards = {card.name: card.kind for card in datasets.catalogue()}
    return [name for name, kind in cards.items() if kind == cards.get(usual, kind)]


def _quoted(text: str) -> str:
    return '"' + text.replace('"', "'") + '"'
