"""What an acquisition will do: shots, ports, light, time and bytes, said before any of it is done."""

from typing import Any

from labctl.bench.laser_limits import check_laser
from labctl.bench.opening import opened
from labctl.engine.inputs import inputs_for
from labctl.engine.plan import Request, aliasing, bytes_needed
from labctl.engine.session import Acquisition
from labctl.runs.live.logs import CommandLog
from protocols.base import ShotKind


def forecast(acquisition: Acquisition) -> dict[str, Any]:
    """What `acquisition` will do; nothing is sent to any instrument. SI units, wavelengths in nm.

    Raises:
        DatasetError, StationError, ProtocolError, OutOfRange: what was asked for is wrong, or this bench cannot do it.
    """
    protocol = acquisition.protocol
    inputs = inputs_for(protocol, acquisition.data)
    shots = protocol.shots(inputs)
    with CommandLog() as log, opened(acquisition.station, log, acquisition.access) as open_bench:
        bench = open_bench.bench
        check_laser(acquisition.station, [one.wavelength_nm for one in protocol.passes(bench)])
        size = bytes_needed(Request(protocol, inputs, acquisition.station), bench)
        passes = protocol.passes(bench)
        aliased = aliasing(protocol.sample_rate, bench.scope.bandwidth_hz)
        seconds, power_w = protocol.duration_s(bench, len(shots)), acquisition.station.laser.power
        return {
            "protocol": protocol.name,
            "digest": protocol.digest(),
            "shots": len(shots),
            "images": sum(shot.kind is ShotKind.IMAGE for shot in shots),
            "passes": len(passes),
            "ports": [list(pass_.patching.values()) for pass_ in passes],
            "samples": protocol.sample_count(inputs),
            "wavelengths_nm": sorted({one.wavelength_nm for one in passes}),
            "laser_power_w": power_w,
            "estimated_seconds_on_a_real_bench": seconds,
            "dose_j": power_w * seconds,
            "bytes_needed": size,
            "armed": bench.armed,
            **({} if aliased is None else {"aliasing": aliased}),
        }
