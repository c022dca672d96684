"""One thread for linear algebra: matrices here are small, threads cost more than they give, and sums depend on them."""

import sys
from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """Inside the block, every library for linear algebra that is loaded by then works on one thread."""
    limited: AbstractContextManager[Any] = _libraries(len(sys.modules)).limit(limits=1)
    return limited


@lru_cache(maxsize=1)
def _libraries(_modules: int) -> ThreadpoolController:
    """Those that are loaded: looking for them takes longer than many a fit, and only an import brings another."""
    return ThreadpoolController()
