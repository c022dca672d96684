"""Read files with little memory and time, and no right to write: prints what became of each as a line of JSON.

What is to be read stands on standard input, a JSON object: kinds of `tests.fuzz.readers.READERS` -> a folder to be in,
and files. Each kind is read by a process of its own, forked from this one, which has imported everything.
"""

import json
import os
import resource
import sys
import time
import warnings
from pathlib import Path

from tests.fuzz.readers import READERS

MEMORY = 768 << 20
"""Bytes of address space beyond what the program has when it begins to read."""
SECONDS = 20


def main() -> None:
    warnings.simplefilter("error")
    for kind, (place, files) in json.load(sys.stdin).items():
        child = os.fork()
        if not child:
            os.chdir(place)
            read(kind, files)
            os._exit(0)
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if ended:
            sys.exit(f"{kind}: the process that read them ended with {ended}")


def read(kind: str, files: list[str]) -> None:
    reader = READERS[kind]
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    space = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (space, space))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    for file in files:
        started = time.process_time()
        try:
            reader.read(Path(file))
            refused, text = "", ""
        except reader.refuses as error:
            refused, text = "as documented", str(error)
        except Exception as error:  # noqa: BLE001 - whatever else is raised is told to the test
            refused, text = type(error).__name__, str(error)
        seconds = time.process_time() - started
        outcome = {"kind": kind, "refused": refused, "text": text, "seconds": seconds}
        print(json.dumps(outcome), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
