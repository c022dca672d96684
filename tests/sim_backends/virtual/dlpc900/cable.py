"""A virtual DLPC900 at the other end of a cable: reports in, reports out, as `HidDevice` has it."""

from collections import deque

from sim_backends.servers.reports import ReportReader
from sim_backends.virtual.dlpc900.instrument import VirtualDlpc900


class Cable:
    """Carries reports to a controller and its replies back; there is nothing to read where there is no reply."""

    def __init__(self, controller: VirtualDlpc900) -> None:
        self.controller = controller
        self.opened = 1
        self._reader = ReportReader()
        self._replies: deque[bytes] = deque()

    def write(self, report: bytes) -> None:
        self._reader.buffer()[: len(report)] = report
        for message in self._reader.received(len(report)):
            execution = self.controller.run(message)
            try:
                next(execution)
            except StopIteration as end:
                self._replies += end.value
            else:
                raise AssertionError("it waits")

    def read(self) -> bytes:
        return self._replies.popleft() if self._replies else b""

    def close(self) -> None:
        self._replies.clear()
