"""The command `labctl`, and `python -m labctl` where its script is not on the path."""

import sys

from labctl.commands.exit_status import INTERRUPTED


def run() -> None:
    """Load the command and run it; Ctrl-C ends it with one status, also while it is loaded."""
    try:
        from labctl.commands.main import main
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    main()


if __name__ == "__main__":
    run()
