"""What a run is doing, folded from its events."""

from typing import Any

import pytest

from labctl.dashboard import wording
from labctl.dashboard.sketches import picture
from labctl.dashboard.state import LINES, Emission, Image, Phase, RunState, advanced
from labctl.runs.live.events import Event

HOSTILE = "<script>alert(1)</script>"


def after(*events: tuple[str, dict[str, Any]]) -> RunState:
    state = RunState()
    for name, fields in events:
        state = advanced(state, Event("2026-11-21T09:15:00.125Z", name, fields))
    return state


STARTED = ("run started", {"protocol": "image-readout", "records": 440, "station": "here", "process": 1})
LIT = ("emission", {"on": True})
MANIFEST = {
    "station": {
        "attenuator": {"address": "here", "attenuation_db": 3.0},
        "amplifier": {"address": "here", "power": 0.1},
        "power_meter": {"address": "here", "tap": 0.01},
    },
    "instruments": {name: {"identity": {"model": "M"}} for name in ("attenuator", "amplifier", "power_meter")},
}


@pytest.mark.parametrize(
    ("events", "phase", "emission"),
    [
        ((), Phase.UNKNOWN, Emission.UNKNOWN),
        ((STARTED,), Phase.PREPARING, Emission.OFF),
        ((STARTED, LIT), Phase.PREPARING, Emission.ON),
        ((STARTED, LIT, ("pass started", {"pass": 0, "passes": 2})), Phase.MEASURING, Emission.ON),
        ((STARTED, LIT, ("emission", {"on": False})), Phase.PREPARING, Emission.OFF),
        ((STARTED, LIT, ("emission", {})), Phase.PREPARING, Emission.ON),
        ((STARTED, LIT, ("safe state", {"reached": True}), ("paused", {})), Phase.PAUSED, Emission.OFF),
        ((STARTED, LIT, ("safe state", {"reached": False, "text": "laser"})), Phase.PREPARING, Emission.UNKNOWN),
        ((STARTED, LIT, ("safe state", {"reached": True}), ("finished", {})), Phase.FINISHED, Emission.OFF),
        ((STARTED, ("failed", {"error": "no"})), Phase.FAILED, Emission.OFF),
    ],
)
def test_phase_and_emission(events: Any, phase: Phase, emission: Emission) -> None:
    state = after(*events)
    assert (state.phase, state.emission) == (phase, emission)


def test_a_killed_run_is_dark_only_if_somebody_says_so() -> None:
    lost = after(STARTED, LIT).without_writer()
    assert (lost.phase, lost.emission) == (Phase.LOST, Emission.UNKNOWN)
    assert "LASER UNKNOWN" in wording.emission(lost)
    saved = after(
        STARTED, LIT, ("safe state", {"reached": True, "by": "supervisor", "text": "made safe"})
    ).without_writer()
    assert (saved.phase, saved.emission) == (Phase.LOST, Emission.OFF)
    assert after(STARTED, ("finished", {})).without_writer().phase is Phase.FINISHED


def test_a_laser_that_did_not_go_dark_is_an_alarm_until_it_is_seen_to() -> None:
    disobeyed = ("safe state", {"reached": False, "disobeyed": ["laser"], "text": "the laser"})
    alarmed = (STARTED, LIT, disobeyed, ("failed", {"error": "no"}))
    assert after(*alarmed).alarm
    assert "LASER MAY STILL EMIT" in wording.emission(after(*alarmed).without_writer())
    assert 'class="emission on"' in wording.emission(after(*alarmed))
    assert after(*alarmed, ("run resumed", {})).alarm, "a run that is begun again has not seen to it yet"
    for end in (("safe state", {"reached": True}), ("seen dark", {}), ("emission", {"on": False})):
        state = after(*alarmed, end)
        assert (state.alarm, state.emission) == (False, Emission.OFF)
    assert not after(STARTED, ("safe state", {"reached": False, "disobeyed": ["awg"]})).alarm


def test_what_stands_behind_the_laser_is_shut_where_it_is_known_to_be() -> None:
    through = ("light let through", {"measured_w": 0.02, "amplified_w": 0.1, "attenuation_db": 3.0})
    lit = (STARTED, ("tuned", {"wavelength_nm": 1550.0}), LIT, through)
    for events, words in (
        ((STARTED,), ["not known", "not known", "not read yet"]),
        (lit[:2], ["shut, set to 3 dB", "off, set to 100 mW", "not read yet"]),
        (lit, ["open, 3 dB", "on, gives 100 mW", "saw the laser give 20 mW"]),
        ((*lit, ("powers read", {"measured_w": 0.019, "amplified_w": 0.099})), ["open", "99 mW", "give 19 mW"]),
        ((*lit, ("safe state", {"reached": True})), ["shut", "off", "give 20 mW"]),
        ((*lit, ("safe state", {"reached": False})), ["not known", "not known", "give 20 mW"]),
    ):
        shown = wording.instruments(after(*events), MANIFEST).split("<dt>")
        found = [line for line in shown if line.startswith(("attenuator", "amplifier", "power meter"))]
        assert [word in line for word, line in zip(words, found, strict=True)] == [True] * 3, found
    assert "on, gives" not in wording.instruments(after(*lit).without_writer(), MANIFEST)
    assert "amplifier" not in wording.instruments(after(*lit), {})


@pytest.mark.parametrize("value", [None, "x", -1, 1e300, float("nan"), True, [], {}, HOSTILE])
def test_fields_of_the_wrong_kind_count_as_absent(value: object) -> None:
    names = ("done", "total", "rate_per_s", "remaining_s", "shot", "kind", "label", "dataset_index", "image", "pass")
    every = dict.fromkeys(names, value) | {
        "ports": value,
        "sample_rate": value,
        "samples": value,
        "text": value,
        "disobeyed": value,
    }
    every |= {"wavelength_nm": value, "power_w": value, "on": value, "reached": value, "what": value, "error": value}
    every |= {"disobeyed": value, "measured_w": value, "amplified_w": value, "attenuation_db": value}
    kinds = (
        "run started",
        "uploading",
        "tuned",
        "power set",
        "emission",
        "drive",
        "patched",
        "light let through",
        "powers read",
        "scope set",
        "pass started",
        "progress",
        "warning",
        "link lost",
        "paused",
        "safe state",
        "finished",
        "stopped",
        "failed",
        "unheard of",
    )
    state = after(*((name, every) for name in kinds))
    shown = wording.emission(state) + wording.progress(state, (0, 0)) + wording.log(state)
    roles = {
        "amplifier": {"identity": {"model": value, "serial": HOSTILE}, "address": value},
        HOSTILE: {},
        "awg": value,
    }
    for found in (value, roles, {name: {"identity": value, "power": value} for name in roles}):
        shown += wording.instruments(state, {"instruments": found, "station": found})
    assert "<script" not in shown
    assert wording.image(state)


def test_text_of_a_run_is_escaped() -> None:
    state = after(
        ("run started", {"protocol": HOSTILE, "station": HOSTILE, "records": 3}),
        ("patched", {"ports": {HOSTILE: HOSTILE}}),
        ("warning", {"text": HOSTILE}),
        ("progress", {"kind": HOSTILE, "image": {"rows": 1, "columns": 1, "bits": HOSTILE}}),
    )
    parts = (
        wording.progress(state, (0, 0)),
        wording.instruments(state, {}),
        wording.log(state, HOSTILE),
        wording.image(state),
    )
    shown = "".join(parts)
    assert "<script" not in shown
    assert shown.count("&lt;script&gt;") >= 4


def test_the_log_is_bounded_and_its_last_line_comes_first() -> None:
    state = after(*(("warning", {"text": f"number {n}"}) for n in range(LINES + 5)))
    assert len(state.log) == LINES
    assert wording.log(state).index(f"number {LINES + 4}") < wording.log(state).index(f"number {LINES}")


def test_an_image_is_drawn_as_its_pixels() -> None:
    drawn = picture(Image(2, 4, "tA=="))  # 1011 0100
    assert 'd="M0 0h1v1h-1zM2 0h2v1h-2zM1 1h1v1h-1z"' in drawn
    assert picture(Image(2, 400, "tA==")) == ""
