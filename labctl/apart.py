"""How a process is started that goes on by itself."""

import subprocess
import sys
from typing import Any


def apart(inherited: tuple[int, ...] = ()) -> dict[str, Any]:
    """What to tell `Popen` to keep the signals of the terminal and of the process group from a new process.

    inherited: descriptors of locks that it has as well; on Windows it cannot have them.
    """
    if sys.platform == "win32":
        # A console that nobody sees. Without any (DETACHED_PROCESS) the real Python, which a virtual environment's
        # Python starts, would open a window: python/cpython#85785
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
    return {"start_new_session": True, "pass_fds": inherited}
