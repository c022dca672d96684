"""What cannot be carried out, found out before anything starts: no folder is made, no run begins, nothing is lit."""

from contextlib import ExitStack
from itertools import chain
from typing import Any

from instruments.bench import Bench
from instruments.errors import LinkError
from labctl.bench.identity import who_they_are
from labctl.bench.laser_limits import check_laser
from labctl.bench.lock import held
from labctl.bench.opening import opened
from labctl.bench.station import Station
from labctl.engine.inputs import inputs_for
from labctl.errors import LabctlError, StationError, UsageError
from labctl.runs.format.layout import is_taken
from labctl.runs.live.logs import CommandLog
from labctl.studies.paper.analyses import analysis_of
from labctl.studies.paper.experiments import Experiment
from labctl.studies.paper.reproduction import Plan
from protocols.base import Measurement


def check(plan: Plan) -> dict[str, Exception]:
    """Find out what cannot be carried out: missing data or torch, wrong files, a bench that is not for it or not armed.

    The instruments of a bench that others serve are asked who they are, in the dark.

    Returns:
        Name of each experiment that cannot -> why.

    Raises:
        UsageError: the folder for the runs holds something.
        LinkError: an instrument cannot be reached.
    """
    if is_taken(plan.folder):
        raise UsageError(f"--out = {plan.folder}: is not empty: name a new folder")
    if plan.store is not None and not plan.station.wholly_simulated:
        raise UsageError(f"--store = {plan.store}: runs of a real bench are measured into --out: leave --store out")
    problems: dict[str, Exception] = {}
    with ExitStack() as stack:
        benches = _Benches(plan, stack)
        for experiment in plan.experiments:
            try:
                _check(experiment, plan, benches)
            except LinkError:
                raise
            except LabctlError as error:
                problems[experiment.name] = error
    return problems


def _check(experiment: Experiment, plan: Plan, benches: "_Benches") -> None:
    """In the order of what it costs: files first, then what the station says, then what its instruments say."""
    analysis_of(experiment)
    seed = plan.seeds_of(experiment)[0]
    loaded: dict[str, Any] = {}  # every column shows and plays the same
    for name, protocol in chain.from_iterable(column.items() for column in plan.columns_of(experiment, seed)):
        if name not in loaded:
            loaded[name] = inputs_for(protocol, plan.data)
        inputs = loaded[name]
        protocol.shots(inputs)
        station = plan.station_for(protocol, seed, experiment.runs[name].parameters)
        bench = benches.opened(station)
        _check_light_path(station, protocol)
        protocol.check_cabling(bench)
        check_laser(station, [pass_.wavelength_nm for pass_ in protocol.passes(bench)])
        bench.require_arm()
        benches.identify(station)
        protocol.check(bench, inputs)


def _check_light_path(station: Station, protocol: Measurement[Any]) -> None:
    """Light does not go from a real instrument to a simulated one; the DMD counts where it is in the light's way.

    Raises:
        StationError: some instruments are simulated and others are not, or the chip is bypassed for good.
    """
    if station.patch_panel.bypass:
        raise StationError(
            f"{station.source}: patch_panel.bypass = true: experiments reach the fibre before the chip as port 0 and "
            f"the chip by its own: wire both, list them in patch_panel.ports, and set patch_panel.bypass = false"
        )
    used = [name for name in station.addresses if name != "dmd" or protocol.projector]
    simulated = [name for name in used if name in station.simulations]
    real = [name for name in used if name not in simulated and name not in station.by_hand]
    if simulated and real:
        raise StationError(
            f"{station.source}: {simulated[0]}.address = 'simulated', but {protocol.name} needs {', '.join(simulated)} "
            f"on the bench of {', '.join(real)}: give its VISA address"
        )


class _Benches:
    """The benches that the runs would use, each opened when the first run asks for it and closed with `stack`."""

    def __init__(self, plan: Plan, stack: ExitStack) -> None:
        self._plan = plan
        self._stack = stack
        self._opened: dict[str, Bench] = {}
        self._identified: set[str] = set()

    def opened(self, station: Station) -> Bench:
        """The bench of `station`; no message is sent."""
        key = station.model_dump_json()
        if key not in self._opened:
            log = self._stack.enter_context(CommandLog())
            found = opened(station, log, self._plan.access)
            self._opened[key] = self._stack.enter_context(found).bench
        return self._opened[key]

    def identify(self, station: Station) -> None:
        """Ask every instrument once who it is, unless they are simulated in this process and cannot be missing."""
        key = station.model_dump_json()
        if key not in self._identified and not station.wholly_simulated:
            with held(station, "labctl reproduce", self._plan.access.wire) as hold:
                self._opened[key].observer = hold
                who_they_are(station, self._opened[key])
        self._identified.add(key)
