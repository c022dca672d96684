"""What the instruments are told to do, told in turn to whoever watches the run."""

from collections.abc import Callable, Mapping
from typing import Any

from instruments.bench import Bench, UnsafeBench
from instruments.values import EdgeTrigger, Timebase
from labctl.runs.live.events import EventLog


def tell_states(bench: Bench, events: EventLog) -> None:
    """Have everything that changes the state of an instrument be an event.

    Emission is told before it is switched on and after it is confirmed off: whoever watches never takes light for dark.
    """
    laser, awg, scope, panel = bench.laser, bench.awg, bench.scope, bench.patch_panel
    emit, darken, tune, set_power = laser.emit, laser.darken, laser.tune, laser.set_power
    play, stop, configure, connect, make_safe = awg.play, awg.stop, scope.configure, panel.connect, bench.make_safe

    def told_emit() -> None:
        events("emission", on=True)
        emit()

    def told_darken() -> None:
        darken()
        events("emission", on=False)

    def told_tune(wavelength_nm: float) -> float:
        settled = tune(wavelength_nm)
        events("tuned", wavelength_nm=settled)
        return settled

    def told_set_power(power_w: float) -> float:
        settled = set_power(power_w)
        events("power set", power_w=settled)
        return settled

    def told_connect(patching: Mapping[int, int]) -> None:
        connect(patching)
        events("patched", ports={str(channel): port for channel, port in patching.items()})

    def told_configure(timebase: Timebase, trigger: EdgeTrigger, channels: tuple[int, ...], averages: int) -> None:
        configure(timebase, trigger, channels, averages)
        events("scope set", channels=list(channels), sample_rate=timebase.sample_rate, samples=timebase.samples)

    def told_make_safe() -> None:
        try:
            make_safe()
        except UnsafeBench as error:
            events("safe state", reached=False, text=str(error))
            raise
        events("safe state", reached=True)

    _replace(laser, emit=told_emit, darken=told_darken, tune=told_tune, set_power=told_set_power)
    _replace(
        awg, play=_after(play, lambda: events("drive", on=True)), stop=_after(stop, lambda: events("drive", on=False))
    )
    _replace(panel, connect=told_connect)
    _replace(scope, configure=told_configure)
    _replace(bench, make_safe=told_make_safe)


def _after(method: Callable[[], None], tell: Callable[[], None]) -> Callable[[], None]:
    def both() -> None:
        method()
        tell()

    return both


def _replace(instrument: Any, **methods: Callable[..., Any]) -> None:
    vars(instrument).update(methods)
