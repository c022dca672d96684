"""What a run is doing, folded from its events. Pure: events in, a state out.

Events come from files, and a run directory may be a stranger's: a field that is not what it should be counts as absent.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from labctl.runs.live.alarm import ABOUT_LIGHT, SEEN_DARK, disobeys
from labctl.runs.live.events import Event
from labctl.runs.live.owner import STARTS

LINES = 200
"""Of the log that are kept."""
LONGEST_TEXT = 500


class Phase(StrEnum):
    """How far a run is, in the words of the page."""

    UNKNOWN = "no events"
    PREPARING = "preparing"
    MEASURING = "measuring"
    PAUSED = "paused"
    FINISHED = "finished"
    STOPPED = "stopped"
    FAILED = "failed"
    LOST = "killed"


ENDED = (Phase.FINISHED, Phase.STOPPED, Phase.FAILED, Phase.LOST)


class Emission(StrEnum):
    """Whether the laser emits, as far as is known."""

    ON = "on"
    OFF = "off"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class LogLine:
    """One line of the log: UTC time, what happened, and whether it asks for attention."""

    time: str
    text: str
    alarming: bool = False


@dataclass(frozen=True)
class Image:
    """A binary image: `bits` is base64, a bit a pixel, row by row, the most significant first."""

    rows: int
    columns: int
    bits: str


@dataclass(frozen=True)
class RunState:
    """A run as its events describe it. None: not known (yet).

    alarm: its laser did not go dark when told to. through: the amplifier is on and the attenuator open, where there are
    such. measured_w: what the laser gives, by the power meter's last reading.
    """

    phase: Phase = Phase.UNKNOWN
    emission: Emission = Emission.UNKNOWN
    alarm: bool = False
    started: Event | None = None
    simulated: bool = False
    mixed: bool = False
    station: str = ""
    protocol: str = ""
    wavelength_nm: float | None = None
    power_w: float | None = None
    through: bool | None = None
    measured_w: float | None = None
    amplified_w: float | None = None
    attenuation_db: float | None = None
    drive: bool | None = None
    scope: str = ""
    patching: tuple[tuple[str, str], ...] = ()
    pass_index: int | None = None
    passes: int | None = None
    done: int = 0
    total: int = 0
    rate_per_s: float | None = None
    remaining_s: float | None = None
    shot: int | None = None
    kind: str = ""
    label: int | None = None
    dataset_index: int | None = None
    image: Image | None = None
    uploading: str = ""
    last_told: str = ""
    log: tuple[LogLine, ...] = ()

    @property
    def has_shot(self) -> bool:
        """Whether a shot with light was reported."""
        return self.shot is not None and self.kind != "dark"

    @property
    def running(self) -> bool:
        """Whether it has begun and not ended."""
        return self.phase is not Phase.UNKNOWN and self.phase not in ENDED

    def without_writer(self) -> "RunState":
        """This state, if no process writes the run any more: one without an event of its end was killed.

        Whether it left light on nobody can know, unless the supervisor reported that it made the bench safe.
        """
        if not self.running:
            return self
        emission = Emission.UNKNOWN if self.emission is Emission.ON else self.emission
        through = self.through and None
        return replace(self, phase=Phase.LOST, emission=emission, through=through, rate_per_s=None, remaining_s=None)


def advanced(state: RunState, event: Event) -> RunState:
    """The state after an event; an event that nobody knows changes nothing."""
    change = _CHANGES.get(event.name)
    if change is None:
        return state
    changed = replace(change(state, event.fields), last_told=event.time)
    if event.name in STARTS:
        changed = replace(changed, started=event)
    words = _WORDS.get(event.name)
    if words is None:
        return changed
    changed = replace(changed, alarm=disobeys(event) if event.name in ABOUT_LIGHT else state.alarm)
    line = LogLine(event.time, _cut(words(event.fields)), _is_alarming(event))
    return replace(changed, log=(*changed.log, line)[-LINES:])


def _started(_state: RunState, fields: Mapping[str, Any]) -> RunState:
    return RunState(
        phase=Phase.PREPARING,
        emission=Emission.OFF,
        protocol=text_in(fields, "protocol"),
        station=text_in(fields, "station"),
        simulated=fields.get("simulated") is True,
        mixed=fields.get("mixed") is True,
        total=int(number_in(fields, "records") or 0),
        done=int(number_in(fields, "done") or 0),
        wavelength_nm=_state.wavelength_nm,
        power_w=_state.power_w,
        log=_state.log,
    )


def _emission(state: RunState, fields: Mapping[str, Any]) -> RunState:
    return replace(state, emission=Emission.ON if fields.get("on") is not False else Emission.OFF)


def _tuned(state: RunState, fields: Mapping[str, Any]) -> RunState:
    """A laser tunes while nothing is let through."""
    return replace(state, wavelength_nm=number_in(fields, "wavelength_nm"), through=False)


def _let_through(state: RunState, fields: Mapping[str, Any]) -> RunState:
    return replace(_powers(state, fields), through=True, attenuation_db=number_in(fields, "attenuation_db"))


def _powers(state: RunState, fields: Mapping[str, Any]) -> RunState:
    return replace(state, measured_w=number_in(fields, "measured_w"), amplified_w=number_in(fields, "amplified_w"))


def _patched(state: RunState, fields: Mapping[str, Any]) -> RunState:
    ports = fields.get("ports")
    pairs = ports.items() if isinstance(ports, dict) else ()
    return replace(state, patching=tuple((_cut(str(channel)), _cut(str(port))) for channel, port in pairs))


def _scope(state: RunState, fields: Mapping[str, Any]) -> RunState:
    rate, samples = number_in(fields, "sample_rate"), number_in(fields, "samples")
    return replace(state, scope=f"{samples:.0f} samples at {rate / 1e9:g} GS/s" if rate and samples else "")


def _pass(state: RunState, fields: Mapping[str, Any]) -> RunState:
    index, passes = number_in(fields, "pass"), number_in(fields, "passes")
    return replace(
        state,
        phase=Phase.MEASURING,
        uploading="",
        pass_index=None if index is None else int(index),
        passes=None if passes is None else int(passes),
    )


def _progress(state: RunState, fields: Mapping[str, Any]) -> RunState:
    numbers = {name: number_in(fields, name) for name in ("shot", "label", "dataset_index")}
    pass_index = number_in(fields, "pass")
    return replace(
        state,
        phase=Phase.MEASURING,
        uploading="",
        pass_index=state.pass_index if pass_index is None else int(pass_index),
        done=int(number_in(fields, "done") or 0),
        total=int(number_in(fields, "total") or 0),
        rate_per_s=number_in(fields, "rate_per_s"),
        remaining_s=number_in(fields, "remaining_s"),
        kind=text_in(fields, "kind"),
        image=_image(fields.get("image")),
        **{name: None if value is None else int(value) for name, value in numbers.items()},  # type: ignore[arg-type]
    )


def _uploading(state: RunState, fields: Mapping[str, Any]) -> RunState:
    done, total = number_in(fields, "done") or 0, number_in(fields, "total") or 0
    part = f"{100 * done / total:.0f} %" if total else ""
    return replace(state, uploading="" if done >= total else f"uploading {text_in(fields, 'what')} {part}")


def _paused(state: RunState, _fields: Mapping[str, Any]) -> RunState:
    return replace(state, phase=Phase.PAUSED, rate_per_s=None, remaining_s=None)


def _going_on(state: RunState, _fields: Mapping[str, Any]) -> RunState:
    return replace(state, phase=Phase.PREPARING)


def _safe(state: RunState, fields: Mapping[str, Any]) -> RunState:
    if fields.get("reached") is not True:
        off = state.emission is Emission.OFF
        return replace(state, emission=Emission.OFF if off else Emission.UNKNOWN, through=state.through and None)
    return replace(
        state, emission=Emission.OFF, through=False, drive=False, image=None, rate_per_s=None, remaining_s=None
    )


def _ended(phase: Phase) -> Callable[[RunState, Mapping[str, Any]], RunState]:
    def ended(state: RunState, _fields: Mapping[str, Any]) -> RunState:
        return replace(state, phase=phase, rate_per_s=None, remaining_s=None, uploading="")

    return ended


def _unchanged(state: RunState, _fields: Mapping[str, Any]) -> RunState:
    return state


_CHANGES: dict[str, Callable[[RunState, Mapping[str, Any]], RunState]] = {
    **dict.fromkeys(STARTS, _started),
    "uploading": _uploading,
    "tuned": _tuned,
    "power set": lambda state, fields: replace(state, power_w=number_in(fields, "power_w")),
    "emission": _emission,
    "light let through": _let_through,
    "powers read": _powers,
    "drive": lambda state, fields: replace(state, drive=fields.get("on") is True),
    "patched": _patched,
    "scope set": _scope,
    "pass started": _pass,
    "progress": _progress,
    "warning": _unchanged,
    "link lost": _unchanged,
    "link recovered": _unchanged,
    "paused": _paused,
    "going on": _going_on,
    "safe state": _safe,
    SEEN_DARK: lambda state, _fields: replace(state, emission=Emission.OFF),
    "finished": _ended(Phase.FINISHED),
    "stopped": _ended(Phase.STOPPED),
    "failed": _ended(Phase.FAILED),
}

_WORDS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "run started": lambda fields: f"{text_in(fields, 'protocol')} started, {_count(fields, 'records')} records",
    "live started": lambda fields: f"live view of ports {_list(fields, 'ports')} started",
    "run resumed": lambda fields: f"{text_in(fields, 'protocol')} resumed at {_count(fields, 'done')} records",
    "emission": lambda fields: "laser on" if fields.get("on") is not False else "laser off",
    "pass started": lambda fields: (
        f"pass {_count(fields, 'pass', 1)} of {_count(fields, 'passes')}: {number_in(fields, 'wavelength_nm')} nm, "
        f"ports {_list(fields, 'ports')}"
    ),
    "warning": lambda fields: text_in(fields, "text"),
    "link lost": lambda fields: text_in(fields, "text"),
    "link recovered": lambda fields: text_in(fields, "text"),
    "paused": lambda _fields: "paused in the dark",
    "going on": lambda _fields: "going on",
    "safe state": lambda fields: (
        text_in(fields, "text")
        or ("safe state reached" if fields.get("reached") is True else "safe state NOT confirmed")
    ),
    SEEN_DARK: lambda _fields: "somebody has seen that the laser is dark",
    "finished": lambda fields: f"finished: {_count(fields, 'shots')} shots",
    "stopped": lambda fields: ": ".join(
        filter(None, ("stopped at once" if fields.get("at_once") is True else "stopped", text_in(fields, "text")))
    ),
    "failed": lambda fields: f"failed: {text_in(fields, 'error')}",
}


def _is_alarming(event: Event) -> bool:
    return event.name in ("warning", "link lost", "failed") or (
        event.name == "safe state" and (event.fields.get("reached") is not True or "text" in event.fields)
    )


def number_in(fields: Mapping[str, Any], name: str) -> float | None:
    """The number of that name; None where there is none, or one that nobody can mean."""
    value = fields.get(name)
    usable = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e15
    return float(value) if usable else None  # type: ignore[arg-type]


def _count(fields: Mapping[str, Any], name: str, first: int = 0) -> str:
    value = number_in(fields, name)
    return "?" if value is None else f"{value + first:.0f}"


def text_in(fields: Mapping[str, Any], name: str) -> str:
    """The text of that name, cut where it is very long; empty where there is none."""
    value = fields.get(name, "")
    return _cut(value) if isinstance(value, str) else ""


def _list(fields: Mapping[str, Any], name: str) -> str:
    value = fields.get(name)
    return _cut(", ".join(map(str, value))) if isinstance(value, list) else "?"


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}..."


def _image(value: object) -> Image | None:
    if not isinstance(value, dict):
        return None
    rows, columns, bits = value.get("rows"), value.get("columns"), value.get("bits")
    if not (isinstance(rows, int) and isinstance(columns, int) and isinstance(bits, str)):
        return None
    return Image(rows, columns, bits) if 0 < rows <= 256 and 0 < columns <= 256 else None
