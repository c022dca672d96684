import subprocess
import sys

from threadpoolctl import threadpool_info, threadpool_limits

from labctl.analysis.threads import one_thread

LOADED_LATER = """
import numpy
from threadpoolctl import threadpool_info, threadpool_limits
from labctl.analysis.threads import one_thread
with one_thread():
    before = len(threadpool_info())
import scipy.linalg
with threadpool_limits(2), one_thread():
    found = [library["num_threads"] for library in threadpool_info()]
assert len(found) > before, "scipy brings a library of its own"
assert set(found) == {1}, found
"""


def numbers() -> list[int]:
    return [library["num_threads"] for library in threadpool_info()]


def test_every_library_has_one_thread_inside_and_what_it_had_behind() -> None:
    for wanted in (2, 3):  # by a look at what is loaded, and by what was found
        with threadpool_limits(wanted):
            before = numbers()
            assert wanted in before
            with one_thread():
                assert set(numbers()) == {1}
            assert numbers() == before


def test_so_has_one_that_is_loaded_later() -> None:
    subprocess.run([sys.executable, "-c", LOADED_LATER], check=True)
