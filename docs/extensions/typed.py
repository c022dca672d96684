"""The directive `typed`: commands as they are typed, and below them what they answered while the page was built.

The commands of a page are carried out in the order of the page in one folder, `made/typed/<page>`, with the simulated
bench. Nothing that they answer is written by hand: a command that ends otherwise than the page says is an error.

```{typed}
labctl train runs/digits
```

`:exit: 130` says what it ends in. `:interrupt: runs/first` presses Ctrl-C once some records of that run are on disk.
`:serve: bench.toml` serves the simulated bench, with that station file, to this and all later commands of the page.
`:hide:` shows the commands only: their answer is long, or says nothing to whom it may be of use.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

LABCTL = (sys.executable, "-m", "labctl")
LONGEST_S = 300
PLAIN = {"COLUMNS": "132", "NO_COLOR": "1", "TERM": "dumb", "PYTHONUNBUFFERED": "1"}
_served: list[subprocess.Popen[str]] = []


class Typed(SphinxDirective):
    """Commands, and what they answered."""

    has_content = True
    option_spec: ClassVar[dict[str, Callable[[str], Any]] | None] = {
        "exit": directives.nonnegative_int,
        "interrupt": directives.unchanged_required,
        "serve": directives.unchanged_required,
        "hide": directives.flag,
    }

    def run(self) -> list[nodes.Node]:
        """A block of what is typed, and one of what came."""
        folder = Path(self.env.srcdir) / "made" / "typed" / self.env.docname.replace("/", "-")
        folder.mkdir(parents=True, exist_ok=True)
        if "serve" in self.options:
            _serve(folder, self.options["serve"])
        typed = "\n".join(self.content)
        answers = [self._answer(shlex.split(line), folder) for line in self.content]
        blocks = [nodes.literal_block(typed, typed, language="text")]
        if "hide" not in self.options and (answer := "\n".join(filter(None, answers))):
            blocks += [nodes.paragraph("", "You should see:"), nodes.literal_block(answer, answer, language="text")]
        return blocks

    def _answer(self, words: list[str], folder: Path) -> str:
        """What a command says on both streams; taken once, although several builders read the page."""
        place = self.env.temp_data["typed"] = self.env.temp_data.get("typed", 0) + 1
        kept = folder / f"answer-{place}.txt"
        if not kept.exists():
            program, *rest = words
            if program != "labctl":
                raise self.error(f"{program}: a page shows what labctl answers")
            process = subprocess.Popen(
                [*LABCTL, *rest],
                cwd=folder,
                env=os.environ | PLAIN,
                text=True,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
            )
            if "interrupt" in self.options:
                _interrupt(process, folder / self.options["interrupt"] / "journal.jsonl")
            try:
                answer, _ = process.communicate(timeout=LONGEST_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                raise self.error(f"labctl {' '.join(rest)}: did not end in {LONGEST_S} s") from None
            if process.returncode != self.options.get("exit", 0):
                raise self.error(f"labctl {' '.join(rest)}: ended in {process.returncode}: {answer}")
            kept.write_text(_as_seen(answer), "utf-8")
        return kept.read_text("utf-8")


def _as_seen(answer: str) -> str:
    """What stays on a terminal: of a line that is written over, its last state."""
    lines = (line.rsplit("\r", 1)[-1].rstrip() for line in answer.replace("\r\n", "\n").split("\n"))
    return re.sub(r"\n{2,}", "\n", "\n".join(lines)).strip("\n")


def _interrupt(process: subprocess.Popen[str], journal: Path) -> None:
    """Ctrl-C once five shards are on disk."""
    end = time.monotonic() + LONGEST_S
    while not journal.exists() or journal.read_text("utf-8").count("\n") < 5:
        if process.poll() is not None or time.monotonic() > end:
            return
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)


def _serve(folder: Path, station: str) -> None:
    """The simulated bench as a service until the page ends."""
    if (folder / station).exists():
        return
    command = [*LABCTL, "sim", "serve", "--save-station", station, "--json"]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
    _served.append(process)
    process.stdout.readline()


def end(_app: Sphinx, _page: nodes.document) -> None:
    """No bench is served any longer than its page is read."""
    while _served:
        with _served.pop() as process:
            process.send_signal(signal.SIGINT)


def begin(app: Sphinx) -> None:
    """Forget the answers of an earlier build, with the HTML."""
    if app.builder.name == "html":
        shutil.rmtree(Path(app.srcdir) / "made" / "typed", ignore_errors=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", begin)
    app.connect("doctree-read", end)
    app.add_directive("typed", Typed)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
