"""The simulated bench: one world, its virtual instruments, up to three network addresses for each."""

from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, Self

from threadpoolctl import threadpool_limits

from sim_backends.parameters import Parameters
from sim_backends.servers.hislip import serve_hislip
from sim_backends.servers.loop import Instrument, Loop
from sim_backends.servers.reports import REPORTS
from sim_backends.servers.socket import LINES, CarriageReturns, Framing, serve_socket
from sim_backends.servers.vxi11 import serve_vxi11
from sim_backends.virtual.alp.instrument import VirtualAlp
from sim_backends.virtual.awg70002a.instrument import VirtualAwg70002a
from sim_backends.virtual.dlpc900.instrument import VirtualDlpc900
from sim_backends.virtual.dpo72504dx.instrument import VirtualDpo72504dx
from sim_backends.virtual.fibre_switch.instrument import VirtualFibreSwitch
from sim_backends.virtual.instrument import VirtualInstrument
from sim_backends.virtual.tlg220.instrument import VirtualTlg220
from sim_backends.world.receivers import Device
from sim_backends.world.world import Noise, World

HISLIP_OFFSET, VXI11_OFFSET = 10, 20  # of the other ports from the ports of the raw sockets
SPEAK_VXI11 = ("awg", "scope")  # as the Tektronix instruments do

Make = Callable[[World], Instrument]
"""Makes a virtual instrument of a world."""


class SimulatedBench:
    """Virtual instruments that share one world and listen on the network, as long as the context lasts.

    Args:
        parameters: The physics; None: the defaults.
        twin_seed: Which fibre, which chip, which noise.
        noise: New for every trigger; "by-state": the same whenever the instruments are set to the same again.
        device: What computes light, noise and codes: "cuda" is a graphics card, if there is one (`world.fallback`).
        host: The address to listen on. The default is reachable from this machine only: clients are not checked.
        port_base: Raw sockets listen on `port_base`, `port_base` + 1, ... in the order of `resources`, HiSLIP on the
            ports 10 higher, VXI-11 20 higher; None: any free ports.
        laser_table: The commands the laser obeys, in the form of `virtual/tlg220/commands.toml`; None: that file.
        plugged_in: What makes further instruments of this world, or others in the place of those that there always are.
        dmd: Which DMD there is. A DLPC900 has a raw socket only: it speaks by HID reports, see `servers.reports`.
    """

    def __init__(
        self,
        parameters: Parameters | None = None,
        *,
        twin_seed: int = 1,
        noise: Noise = "by-trigger",
        device: Device = "cpu",
        host: str = "127.0.0.1",
        port_base: int | None = None,
        laser_table: Mapping[str, Any] | None = None,
        plugged_in: Mapping[str, Make] | None = None,
        dmd: Make = VirtualAlp,
    ) -> None:
        self.world = World(parameters, twin_seed=twin_seed, noise=noise, device=device)
        self.resources: dict[str, dict[str, str]] = {}
        self._host = host
        self._port_base = port_base
        self._loop: Loop | None = None
        always: dict[str, Make] = {
            "awg": VirtualAwg70002a,
            "scope": VirtualDpo72504dx,
            "laser": lambda world: VirtualTlg220(world, laser_table),
            "dmd": dmd,
            "patch_panel": VirtualFibreSwitch,
        }
        self._instruments: dict[str, Instrument] = {
            role: make(self.world) for role, make in {**always, **(plugged_in or {})}.items()
        }

    def start(self) -> None:
        """Begin to listen; every address in `resources` answers when this returns.

        Raises:
            OSError: A port is taken, or `host` is not an address of this machine.
            RuntimeError: The bench is running.
        """
        if self._loop is not None:
            raise RuntimeError("the simulated bench is running: stop it before starting it again")
        loop = Loop()
        try:
            self.resources = {
                role: self._serve(loop, role, instrument, rank)
                for rank, (role, instrument) in enumerate(self._instruments.items())
            }
        except OSError:
            loop.stop()
            raise
        # One BLAS thread: the products of a frame are too small to share, and sums depend on the number of threads.
        self._threads = threadpool_limits(1)
        loop.start()
        self._loop = loop

    @property
    def running(self) -> bool:
        """Whether clients are served; False again when an error in a virtual instrument has ended it."""
        return self._loop is not None and self._loop.running

    @property
    def failed(self) -> bool:
        """Whether an error in a virtual instrument has ended it, which `stop` raises."""
        return self._loop is not None and self._loop.failed

    def stop(self) -> None:
        """Close every connection and wait until nothing runs any more; may be called again.

        Raises:
            BaseException: Whatever a virtual instrument raised while the bench was running: an error in it, which had
                ended all connections.
        """
        loop, self._loop = self._loop, None
        if loop is not None:
            try:
                loop.stop()
            finally:
                self._threads.restore_original_limits()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def _serve(self, loop: Loop, role: str, instrument: Instrument, rank: int) -> dict[str, str]:
        host = self._host

        def port(offset: int) -> int:
            return 0 if self._port_base is None else self._port_base + offset + rank

        if isinstance(self._instruments[role], VirtualDlpc900):
            return {"socket": f"TCPIP0::{host}::{serve_socket(loop, instrument, host, port(0), REPORTS)}::SOCKET"}
        made = self._instruments[role]
        terminator = made.TERMINATOR if isinstance(made, VirtualInstrument) else LINES.ending
        framing = LINES if terminator == LINES.ending else Framing(CarriageReturns, terminator)
        socket_port = serve_socket(loop, instrument, host, port(0), framing)
        addresses = {
            "socket": f"TCPIP0::{host}::{socket_port}::SOCKET",
            "hislip": f"TCPIP0::{host}::hislip0,{serve_hislip(loop, instrument, host, port(HISLIP_OFFSET))}::INSTR",
        }
        if role in SPEAK_VXI11:
            vxi11_port = serve_vxi11(loop, instrument, host, port(VXI11_OFFSET))
            addresses["vxi11"] = f"TCPIP0::{host},{vxi11_port}::inst0::INSTR"
        return addresses
