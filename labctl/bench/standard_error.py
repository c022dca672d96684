"""Standard error, of which nobody waits long for what it does not take."""

import os
from _thread import allocate_lock, start_new_thread
from contextlib import suppress

STANDARD_ERROR = 2
PATIENCE_S = 0.2


def tell_past_the_buffer(text: bytes) -> None:
    """Write `text` past the buffer, which whatever is interrupted may be writing to; wait for that a moment at most.

    A terminal that is held (Ctrl-S), or that nobody reads, takes it later or never: a thread is left waiting for that.
    What handles a signal may call this, since it needs no lock that anybody else has.
    """
    written = allocate_lock()
    written.acquire()

    def write() -> None:
        with suppress(OSError):  # nobody is there any more
            os.write(STANDARD_ERROR, text)
        written.release()

    start_new_thread(write, ())
    written.acquire(timeout=PATIENCE_S)
