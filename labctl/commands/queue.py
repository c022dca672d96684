"""The queue: runs and sweeps one after the other, through the night."""

from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any

import typer

from labctl.bench.signals import interruptible
from labctl.commands.exit_status import DONE, FELL_SHORT, INTERRUPTED
from labctl.commands.options import LARGEST_NUMBER
from labctl.commands.output import JsonOption, say, show, table, tell
from labctl.errors import UsageError
from labctl.printable import typed
from labctl.runs.format.layout import is_taken
from labctl.runs.queue import Item, Queue, Wish
from labctl.studies.queue.work import OnFailure, Worked, ask, forecast, settle, work
from labctl.user import user

app = typer.Typer(help=__doc__, no_args_is_help=True, rich_markup_mode=None, add_completion=False)

FolderOption = Annotated[Path, typer.Option("--folder", help="Folder of the runs; the queue is a file in it.")]
Number = Annotated[int, typer.Argument(max=LARGEST_NUMBER, help="Number of an item, as `labctl queue list` has it.")]
RUNS = Path("runs")


@app.command("add", context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
def add(
    words: Annotated[list[str], typer.Argument(metavar="run|sweep ...", help="A command as it is typed after labctl.")],
    folder: FolderOption = RUNS,
    as_json: JsonOption = False,
) -> int:
    """Add a run or a sweep; what it asks for is checked now. Options of the queue come before the command."""
    out = _out(words)
    if out is not None and is_taken(out):
        raise UsageError(f"--out = {out}: is not empty: name a new folder")
    plan = forecast(words)
    item = Queue(folder).add(words, out, _kept(plan), user())
    show(_described(item), as_json, lambda: say(f"{item.number}: {_what(item)}, {_time(item)} on a real bench"))
    return DONE


@app.command("list")
def list_items(folder: FolderOption = RUNS, as_json: JsonOption = False) -> int:
    """List the items: done, running, waiting."""
    items = settle(Queue(folder))
    show(
        {"items": [_described(item) for item in items]},
        as_json,
        lambda: _print(items) if items else say(f"{folder}: nothing in the queue"),
    )
    return DONE


@app.command("move")
def move(
    number: Number,
    to: Annotated[int, typer.Option("--to", help="Place among those that wait; 1 is the next.")],
    folder: FolderOption = RUNS,
    as_json: JsonOption = False,
) -> int:
    """Move a waiting item to another place."""
    _settled(folder).move(number, to)
    return list_items(folder, as_json)


@app.command("remove")
def remove(number: Number, folder: FolderOption = RUNS, as_json: JsonOption = False) -> int:
    """Take an item out of the queue; what it has measured stays."""
    _settled(folder).remove(number)
    return list_items(folder, as_json)


@app.command("start")
def start(
    on_failure: Annotated[
        OnFailure, typer.Option("--on-failure", help="What to do with the rest when an item fails.")
    ] = OnFailure.STOP,
    folder: FolderOption = RUNS,
    as_json: JsonOption = False,
) -> int:
    """Carry out the waiting items, one after the other; the bench is dark between them. Ctrl-C ends item and queue."""
    with interruptible() as interruption:
        found = work(Queue(folder), on_failure, interruption, tell)
    show(vars(found), as_json, lambda: _print_worked(found))
    if found.failed:
        return FELL_SHORT
    return INTERRUPTED if found.waiting else DONE


@app.command("stop")
def stop(
    now: Annotated[bool, typer.Option("--now", help="Do not wait for the end of the item; it goes on later.")] = False,
    folder: FolderOption = RUNS,
    as_json: JsonOption = False,
) -> int:
    """Stop the queue after the running item, or after its shot."""
    wish = Wish.STOP_NOW if now else Wish.STOP
    ask(Queue(folder), wish)
    show({"asked": wish}, as_json, lambda: say(f"{folder}: the queue ends after this {'shot' if now else 'item'}"))
    return DONE


def _settled(folder: Path) -> Queue:
    queue = Queue(folder)
    settle(queue)
    return queue


def _out(words: list[str]) -> Path | None:
    """Where the command of these words goes: of several `--out` it takes the last, and of what is behind `--` none."""
    found = None
    for place, word in enumerate(takewhile("--".__ne__, words)):
        if word == "--out" and place + 1 < len(words):
            found = Path(words[place + 1])
        elif word.startswith("--out="):
            found = Path(word.removeprefix("--out="))
    return found


def _kept(plan: dict[str, Any]) -> dict[str, Any]:
    return {key: plan[key] for key in ("shots", "estimated_seconds_on_a_real_bench", "dose_j", "bytes_needed", "files")}


def _described(item: Item) -> dict[str, Any]:
    return vars(item) | {"words": list(item.words), "directory": str(item.directory)}


def _what(item: Item) -> str:
    return f"labctl {typed(*item.words)}"


def _time(item: Item) -> str:
    return f"{item.plan.get('estimated_seconds_on_a_real_bench', 0) / 60:.1f} min"


def _print(items: list[Item]) -> None:
    table(
        ("", "state", "what", "by", "real bench", ""),
        ((item.number, item.state, _what(item), item.added_by, _time(item), item.message) for item in items),
    )


def _print_worked(found: Worked) -> None:
    say(f"{found.done} done, {found.failed} failed, {found.waiting} wait")
    if found.waiting or found.failed:
        say("next: labctl queue list")
