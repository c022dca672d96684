"""The page of the queue: what waits, runs, is done or failed, its order, and the buttons to carry it out."""

from collections.abc import Callable
from functools import partial

from nicegui import ui
from nicegui.run import io_bound as in_a_thread

from labctl.dashboard.frame import REFRESH_S, frame, heading
from labctl.dashboard.launcher import in_words
from labctl.dashboard.list_wording import run_address
from labctl.dashboard.monitor import Watching
from labctl.dashboard.starting import begin
from labctl.dashboard.wording import duration
from labctl.errors import LabctlError
from labctl.printable import printable
from labctl.runs.format.layout import RunPaths
from labctl.runs.queue import Item, Queue, State, Wish
from labctl.runs.sweep import is_sweep

SHOWN = 200
"""Of what is done or failed: the last so many."""
ON_FAILURE = {"stop": "stop after a failure", "go-on": "go on after a failure"}


def show_queue(watching: Watching) -> None:
    """The queue of the folder."""
    frame(watching, "Queue")
    with ui.element("main"), ui.element("section"):
        heading("Queue")
        page = QueuePage(watching)
        ui.link("Add a run or a sweep", "/start").classes("adding")
    ui.timer(REFRESH_S, page.refresh)


class QueuePage:
    """What stands in the queue; each row is drawn anew when something has changed."""

    def __init__(self, watching: Watching) -> None:
        """For the queue in a folder of runs."""
        self._watching = watching
        self._queue = Queue(watching.folder)
        self._drawn: list[Item] | None = None
        with ui.element("div").classes("buttons"):
            ui.button("Start", on_click=self._start, color=None).classes("start")
            self._on_failure = ui.select(ON_FAILURE, value="stop").classes("on-failure").props("dense")
            ui.button("Stop after this item", on_click=lambda: self._ask(Wish.STOP), color=None).classes("stop")
            ui.button("Stop now", on_click=lambda: self._ask(Wish.STOP_NOW), color=None).classes("stop-now")
        self._message = ui.label().classes("message")
        self._problem = ui.label().classes("message unread")
        self._items = ui.element("div").classes("queue")

    async def refresh(self) -> None:
        """Show the queue as it is now; it may be long until another process lets it be read."""
        try:
            items = await in_a_thread(self._watching.settle, self._queue)
        except LabctlError as error:
            self._problem.set_text(str(error))
            return
        self._problem.set_text("")
        if items is not None and items != self._drawn:  # None: the dashboard is ending
            self._drawn = items
            self._items.clear()
            with self._items:
                self._show(items)

    def _show(self, items: list[Item]) -> None:
        if not items:
            ui.label("nothing in the queue").classes("nothing")
        waiting = [item.number for item in items if item.state is State.WAITING]
        past = [item for item in items if item.state is not State.WAITING]
        for item in [*past[-SHOWN:], *(item for item in items if item.state is State.WAITING)]:
            with ui.element("div").classes(f"item {item.state}"):
                ui.label(f"{item.number}").classes("number")
                ui.label(item.state).classes("state")
                with ui.element("div").classes("what"):
                    self._show_words(item)
                with ui.element("div").classes("order"):
                    if item.state is State.WAITING:
                        place = waiting.index(item.number) + 1
                        self._button("↑", "earlier", partial(self._move, item, place - 1))
                        self._button("↓", "later", partial(self._move, item, place + 1))
                    if item.state is not State.RUNNING:
                        self._button("✕", "remove", partial(self._queue.remove, item.number))

    def _show_words(self, item: Item) -> None:
        words = in_words(item.words)
        if RunPaths(item.directory).manifest.exists() and self._watching.listing.has(item.directory.name):
            ui.link(words, f"/{run_address(item.directory.name)}")
        elif is_sweep(item.directory) and (self._watching.folder / item.directory.name).exists():
            ui.link(words, f"/sweep/{item.directory.name}")
        else:
            ui.label(words)
        seconds = item.plan.get("estimated_seconds_on_a_real_bench")
        took = f"{duration(seconds)} on a real bench" if isinstance(seconds, int | float) else ""
        by = f"by {printable(item.added_by)}" if item.added_by else ""
        began = f"began {item.began[:16].replace('T', ' ')}" if item.began else ""
        ended = f"ended {item.ended[:16].replace('T', ' ')}" if item.ended else ""
        ui.label(" · ".join(filter(None, (by, took, began, ended)))).classes("about")
        if item.message:
            ui.label(printable(item.message)).classes("problem")

    def _button(self, sign: str, name: str, act: Callable[[], None]) -> None:
        ui.button(sign, on_click=lambda: self._acted(act), color=None).props(f'flat dense aria-label="{name}"')

    async def _acted(self, act: Callable[[], None], done: str = "") -> None:
        try:
            await in_a_thread(act)
        except LabctlError as error:
            self._message.set_text(str(error))
        else:
            self._message.set_text(done)
        await self.refresh()

    def _move(self, item: Item, place: int) -> None:
        waiting = sum(one.state is State.WAITING for one in self._queue.items())
        self._queue.move(item.number, min(max(place, 1), waiting))

    async def _ask(self, wish: Wish) -> None:
        await self._acted(partial(self._watching.ask, self._queue, wish), "asked to stop")

    async def _start(self) -> None:
        words = ["queue", "start", "--folder", str(self._watching.folder), f"--on-failure={self._on_failure.value}"]
        await begin(words, self._watching, self._message)
