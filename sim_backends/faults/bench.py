"""The simulated bench with faulty instruments, on every transport."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from sim_backends.bench import Make, SimulatedBench
from sim_backends.faults.catalogue import Fault, Moment
from sim_backends.faults.injection import Faulty, Injection
from sim_backends.parameters import Parameters
from sim_backends.servers.loop import Instrument, Loop
from sim_backends.virtual.alp.instrument import VirtualAlp
from sim_backends.world.receivers import Device
from sim_backends.world.world import Noise


class Befalling(NamedTuple):
    """A fault that befalls the instrument `role` at `moment`."""

    role: str
    fault: Fault
    moment: Moment


class FaultyBench(SimulatedBench):
    """A simulated bench in which faults befall instruments, whichever of their addresses a client takes.

    A fault strikes once in the life of the bench, or so often as its moment says, whoever sent the message.
    """

    def __init__(
        self,
        faults: Sequence[Befalling],
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
        super().__init__(
            parameters,
            twin_seed=twin_seed,
            noise=noise,
            device=device,
            host=host,
            port_base=port_base,
            laser_table=laser_table,
            plugged_in=plugged_in,
            dmd=dmd,
        )
        self._injections: dict[str, list[Injection]] = {role: [] for role in self._instruments}
        for role, fault, moment in faults:
            self._injections[role].append(Injection(role, self._instruments[role], fault, moment))

    @property
    def struck(self) -> bool:
        """Whether the moment of every fault has come."""
        return all(injection.struck for injections in self._injections.values() for injection in injections)

    def _serve(self, loop: Loop, role: str, instrument: Instrument, rank: int) -> dict[str, str]:
        injections = self._injections[role]
        if not injections:
            return super()._serve(loop, role, instrument, rank)
        before = loop.ports
        addresses = super()._serve(loop, role, Faulty(instrument, injections), rank)
        own = [port for port in loop.ports if port not in before]

        def refuse() -> None:
            for port in own:
                loop.refuse(port)

        for injection in injections:
            injection.refuse = refuse
            injection.begin()
        return addresses
