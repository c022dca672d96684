"""A dask cluster on this machine's loopback: processes of their own."""

import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

from distributed import Client

DASK = (sys.executable, "-m", "dask")


class Cluster:
    """A scheduler and its workers, processes of this machine."""

    def __init__(self, folder: Path, stack: ExitStack, workers: int = 2) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self._port = port
        self._folder = folder
        self._stack = stack
        self.scheduler = self._begun("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        self.workers = [self.worker() for _ in range(workers)]

    def worker(self, threads: int = 1, checkout: Path | None = None) -> subprocess.Popen[bytes]:
        """One more, which runs the labctl of a `checkout` if not that of the tests."""
        words = ("worker", self.address, "--nthreads", str(threads), "--no-nanny", "--no-dashboard")
        return self._begun(*words, "--local-directory", str(self._folder), checkout=checkout)

    def have(self, workers: int) -> None:
        """Return when there are so many workers: in place of the killed come others, whoever is too many goes."""
        alive = [one for one in self.workers if one.poll() is None]
        for process in alive[workers:]:
            process.kill()
            process.wait()
        self.workers = alive[:workers] + [self.worker() for _ in range(workers - len(alive))]
        if workers:
            self.until_there(workers)

    def lose_all(self, workers: int = 1) -> None:
        """The scheduler is killed, and its workers; another one comes to its place, with so many workers."""
        for process in (self.scheduler, *self.workers):
            process.kill()
            process.wait()
        self.scheduler = self._begun("scheduler", "--host", "127.0.0.1", "--port", str(self._port), "--no-dashboard")
        self.workers = [self.worker() for _ in range(workers)]

    def until_there(self, workers: int) -> None:
        """Return when so many workers have come."""
        with Client(self.address, timeout=60, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(workers, timeout=60)

    def _begun(self, *words: str, checkout: Path | None = None) -> subprocess.Popen[bytes]:
        quiet = subprocess.DEVNULL
        process = subprocess.Popen([*DASK, *words], stdout=quiet, stderr=quiet, cwd=checkout)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process
