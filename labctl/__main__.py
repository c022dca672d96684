"""`python -m labctl`: the command `labctl` where it is not on the path."""

from labctl.main import main

if __name__ == "__main__":
    main()
