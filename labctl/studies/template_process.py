"""What the process loads first that those of a pool are copies of: all that it loads after this is there for good.

Python's collector of garbage would look through it again and again while it grows, and once more when it ends. Ctrl-C
reaches the whole process group: whoever began this process ends it, and blocked the signal for as long as it started.
"""

import atexit
import gc
import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
gc.disable()
atexit.register(gc.freeze)
