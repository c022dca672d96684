"""Opening a browser without showing the link to others: every user of a machine can read every command line."""

import os
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread

PAGE = '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url={link}"><title>labctl</title>'


@contextmanager
def opened(invite: Callable[[Callable[[], None]], str]) -> Iterator[None]:
    """Open a browser at a file that leads on to a link of its own and that only its owner can read.

    It is removed when the link is used, which is when `invite` is told to call back, and at the latest at the end.
    The folder is in the home folder and not hidden, since a browser that is installed as a snap can read nothing else.

    Raises:
        OSError: the file cannot be written.
    """
    folder = TemporaryDirectory(prefix="labctl-", dir=os.path.expanduser("~"))
    with folder as name:
        page = Path(name) / "open.html"
        link = invite(folder.cleanup)
        with open(os.open(page, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            file.write(PAGE.format(link=escape(link)))
        # some browsers come back only when they end, and they need the server meanwhile
        Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()
        yield
