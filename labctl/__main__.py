"""`python -m labctl`: the command `labctl` where its script is not on the path."""

from labctl.commands.main import main

main()
