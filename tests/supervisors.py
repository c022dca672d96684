"""Supervisors of the tests' own runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from labctl.bench.supervision import _Supervisor


@contextmanager
def none_left() -> Iterator[None]:
    """No supervisor outlives the block: one that still tries to reach a laser would find another instrument there."""
    supervisors: list[_Supervisor] = []
    begin = _Supervisor.__init__

    def kept(self: _Supervisor, *arguments: object) -> None:
        begin(self, *arguments)  # type: ignore[arg-type]
        supervisors.append(self)

    with patch.object(_Supervisor, "__init__", kept):
        yield
    for supervisor in supervisors:
        supervisor._process.kill()
        supervisor._process.wait()
