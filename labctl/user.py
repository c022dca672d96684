"""Who types a command."""

import getpass

from labctl.printable import printable


def user() -> str:
    """The name of the user of this process, as it may be shown; empty where he has none.

    None has the number of a user in a container, or somebody on Windows without USERNAME.
    """
    try:
        return printable(getpass.getuser())
    except (OSError, KeyError, ImportError):
        return ""
