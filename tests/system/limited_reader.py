"""Read files with little memory and time, and no right to write: prints what became of each as a line of JSON.

Usage: `limited_reader.py KIND FILE...`; KIND is one of `tests.fuzz.readers.READERS`.
"""

import json
import resource
import sys
import time
import warnings
from pathlib import Path

from tests.fuzz.readers import READERS

MEMORY = 768 << 20
"""Bytes of address space beyond what the program has when it begins to read."""
SECONDS = 20


def main(kind: str, files: list[str]) -> None:
    warnings.simplefilter("error")
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
        print(json.dumps({"refused": refused, "text": text, "seconds": seconds}), flush=True)  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
