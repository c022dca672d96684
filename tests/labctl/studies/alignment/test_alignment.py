"""`labctl align` on simulated benches: estimates against the world's own values; faults told."""

import json
import re
from collections.abc import Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from instruments.alnair_tlg220 import Tlg220
from instruments.errors import InstrumentError
from instruments.interfaces import BYPASS_PORT
from instruments.safe_state import UnsafeBench
from labctl.bench.calibration import newest
from labctl.bench.lock import held
from labctl.bench.opening import Access, opened
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION, Station, read_station
from labctl.engine.inputs import images_for
from labctl.errors import AnalysisError
from labctl.runs.live.logs import CommandLog
from labctl.studies.alignment.alignment import SEED, Aligned, align_bench
from labctl.studies.alignment.findings import COVERAGE, Finding
from labctl.studies.alignment.steps import of_dark, of_delay, of_depth, of_range
from protocols.alignment import DEPTH_IMAGES, PROBES, Answered, Dark, Ranged, align, blocks, hopped
from protocols.base import MOST_AVERAGES
from protocols.image_readout import ImageReadout
from sim_backends.parameters import Parameters
from tests.command_line import answer, labctl
from tests.labctl.studies.alignment import world_truth as truth

PORTS = (1, 2, 3, 4)
AC = {"detector_coupling": "ac"}
Pull = tuple[float, float, float]


def aligned(station: Station, directory: Path) -> Aligned:
    told: list[Finding] = []
    with held(station, "a test") as hold:
        found = align_bench(station, Access(), hold, directory=directory, interruption=Interruption(), tell=told.append)
    assert found is not None
    assert tuple(told) == found.findings
    return found


def twin(seed: int, *, projector: bool = True, **parameters: Any) -> Station:
    station = SIMULATED_STATION.twin(seed).cabled(projector=projector)
    return station.model_copy(
        update={"sim": station.sim.model_copy(update={"parameters": {"laser_tuning_s": 0.0, **parameters}})}
    )


def true_values(station: Station, directory: Path) -> Mapping[tuple[str, int | None], float]:
    """By what a finding is called and its channel."""
    images = images_for(ImageReadout(images=PROBES, seed=SEED))
    world = truth.world(station, images, PORTS)
    amplitude = station.awg.amplitude
    values: dict[tuple[str, int | None], float] = {
        ("trigger to light", None): truth.light_delay_s(world.parameters),
    }
    scales = vertical_scales(directory)
    if station.wiring.projector:
        values["drive depth", None] = truth.drive_depth(world.parameters, amplitude)
        width = "half width of the speckle's correlation with wavelength"
        values[width, None] = truth.half_width_m(world.parameters, station.sim.twin_seed)
    for place in range(len(PORTS)):
        channel = place + 1
        values["dark level", channel] = float(world.offset_v[place])
        values["noise in the dark", channel] = float(world.dark_noise_v()[place])
        values["range used", channel] = float(np.ptp(world.clean[:, place])) / (10 * scales[place])
        values["signal to noise", channel] = float(world.repeatability_db(np.array(scales))[place])
        if station.wiring.projector:
            values["contrast between images", channel] = float(world.contrast()[place])
    return values


def vertical_scales(directory: Path) -> list[float]:
    """V per division of each channel while its range was judged: the last that were set before the first averages."""
    scales = [0.0] * len(PORTS)
    for line in (directory / "commands.log").read_text("utf-8").splitlines():
        text = line.split(" ", 3)[-1]
        if "HORizontal:FASTframe:STATE ON" in text:
            break
        for channel in range(1, len(PORTS) + 1):
            if text.startswith(f"CH{channel}:SCAle "):
                scales[channel - 1] = float(text.split()[-1])
    return scales


def pulls(station: Station, directory: Path) -> dict[str, Pull]:
    """Estimate, truth, and their distance in standard uncertainties, by finding."""
    found = [finding.values() for finding in aligned(station, directory).findings]
    return pulls_of(found, station, directory)


def pulls_of(found: Sequence[dict[str, Any]], station: Station, directory: Path) -> dict[str, Pull]:
    """As `pulls`, of findings as they are stored."""
    values = true_values(station, directory)
    table: dict[str, Pull] = {}
    for finding in found:
        what, channel, value = finding["what"], finding["channel"], finding["value"]
        true = values[what, channel]
        apart = (value - true) / (finding["uncertainty"] / COVERAGE)
        table[f"{what} {channel or ''}".strip()] = value, true, apart
    return table


def command_line(station: str, directory: Path) -> tuple[int, dict[str, Any], list[str]]:
    """`labctl align --json` with a station file that says so: exit status, the object, and the lines for people."""
    file = directory.with_suffix(".toml")
    file.write_text(station, encoding="utf-8")
    status, found, told = answer("align", "--station", file, "--arm", "--out", directory, "--json")
    return status, found, told.splitlines()


def test_the_command_finds_every_value_of_the_world_within_its_stated_uncertainty(tmp_path: Path) -> None:
    directory = tmp_path / "aligned"
    station = "[sim]\ntwin_seed = 1\nparameters = { laser_tuning_s = 0.0 }\n"
    status, found, lines = command_line(station, directory)
    assert status == 0
    assert len(lines) == 23
    assert all(": good (" in line for line in lines)
    assert found["good"]
    assert found["calibration"] == str(directory / "calibration.json")
    assert json.loads((directory / "calibration.json").read_text("utf-8"))["findings"] == found["findings"]
    assert Path(found["report"]).is_file()
    table = pulls_of(found["findings"], twin(1), directory)
    assert not {what: row for what, row in table.items() if abs(row[2]) > COVERAGE}
    assert len(table) == 23


@pytest.mark.full
def test_so_it_is_on_ten_twins(tmp_path: Path) -> None:
    rows = {
        f"{seed}: {what}": row for seed in range(1, 11) for what, row in pulls(twin(seed), tmp_path / str(seed)).items()
    }
    assert not {what: row for what, row in rows.items() if abs(row[2]) > COVERAGE}
    assert len(rows) == 230


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
def test_so_it_is_where_light_goes_straight_into_the_chip(seed: int, tmp_path: Path) -> None:
    table = pulls(twin(seed, projector=False), tmp_path / "aligned")
    assert not {what: row for what, row in table.items() if abs(row[2]) > COVERAGE}
    assert len(table) == 17


def depth(station: Station) -> Finding:
    """What the mean signals before the chip say."""
    with CommandLog() as log, opened(station, log) as open_bench:
        bench = open_bench.bench
        with bench.emitting(station.laser.wavelength):
            bench.patch_panel.connect({1: BYPASS_PORT})
            piece = hopped(bench, {1: BYPASS_PORT}, blocks(bench, SEED)[:DEPTH_IMAGES])
    return of_depth(piece).findings[0]


@pytest.mark.parametrize(
    ("rf_gain", "seed"),
    [
        (rf_gain, seed) if seed == 1 and rf_gain == 5.6 else pytest.param(rf_gain, seed, marks=pytest.mark.full)
        for rf_gain in (1.6, 3.2, 5.6, 8.0, 11.3, 16.3, 22.0)
        for seed in (1, 2, 3, 4)
    ],
)
def test_shallow_drives_are_known_as_well_as_stated(rf_gain: float, seed: int) -> None:
    """From 0.1 pi to 1.3 pi: the generator at its lowest amplitude, 0.25 Vpp, and less gain behind it.

    k as everywhere: one of these 28 is beyond it once in 500 times. It must not be had by stating nothing: from a third
    of pi on the depth x is told to three tenths. What tells is the part (x / 4)^2 = 0.07 by which a whole drive moves
    the signal less than four times what half of one does; noise, poles known to a factor of 1.6 and the amplifier's
    saturation hide some of it. Of a tenth of pi not even a bound need be left.
    """
    station = twin(seed, rf_gain=rf_gain)
    station = station.model_copy(update={"awg": station.awg.model_copy(update={"amplitude": 0.25})})
    true = truth.drive_depth(Parameters.model_validate(station.sim.parameters), 0.25)
    try:
        found = depth(station).estimate
    except AnalysisError:
        assert true < 0.15 * np.pi
        return
    assert found is not None
    assert abs(found.value - true) <= COVERAGE * found.uncertainty
    assert true < 0.3 * np.pi or COVERAGE * found.uncertainty < 0.3 * true


@pytest.mark.parametrize(
    ("saturation_v", "v_pi_v"),
    [(1000.0, 1.483), *(pytest.param(*volts, marks=pytest.mark.full) for volts in ((20.0, 1.483), (1000.0, 2.6)))],
)
def test_deep_drives_are_not_taken_for_those_that_come_round_to_the_same_phases(
    saturation_v: float, v_pi_v: float
) -> None:
    """Of 6 pi a quarter is 2 pi less a quarter of 2 pi, which the bench has by itself; and of 3.4 pi."""
    station = twin(1, rf_saturation_v=saturation_v, v_pi_v=v_pi_v)
    true = truth.drive_depth(Parameters.model_validate(station.sim.parameters), station.awg.amplitude)
    found = depth(station)
    assert found.estimate is not None
    assert abs(found.estimate.value - true) <= COVERAGE * found.estimate.uncertainty
    assert found.advice == "more than 3 pi: lower awg.amplitude or the RF gain"


@pytest.mark.parametrize(
    "parameters",
    [{"rf_gain": 0.001}, *(pytest.param(one, marks=pytest.mark.full) for one in ({"rf_gain": 0.3}, AC))],
    ids=["no drive", "hardly any", "no mean signal"],
)
def test_where_nothing_but_noise_moves_the_mean_signal_there_is_no_depth(parameters: dict[str, Any]) -> None:
    with pytest.raises(AnalysisError, match="does not follow the drive: check modulator and RF amplifier, and that"):
        depth(twin(1, **parameters))


def delay(station: Station) -> Finding:
    """What the two sequences of an alignment say."""
    images = images_for(ImageReadout(images=PROBES, seed=SEED))
    with CommandLog() as log, opened(station, log) as open_bench:
        pieces = align(open_bench.bench, images, ports=PORTS, wavelength_nm=station.laser.wavelength, seed=SEED)
        with closing(pieces):
            return of_delay(next(piece for piece in pieces if isinstance(piece, Answered))).findings[0]


class TestDelay:
    """What two sequences tell of the whole periods in a delay."""

    def test_light_that_comes_before_the_trigger_is_found(self) -> None:
        station = twin(1, projector=False, path_delay_s=-2.6e-9)
        true = truth.light_delay_s(Parameters.model_validate({"light_path": "direct", **station.sim.parameters}))
        found = delay(station).estimate
        assert true < -1e-9
        assert found is not None
        assert abs(found.value - true) <= COVERAGE * found.uncertainty

    def test_a_delay_beyond_reach_is_not_told(self) -> None:
        with pytest.raises(AnalysisError, match=r"not measured: two sequences disagree by \d+ ps: .* -20 to 1000 ns "):
            delay(twin(1, projector=False, path_delay_s=1.5e-6))

    def test_sequences_that_tell_no_two_delays_apart_tell_none(self) -> None:
        with pytest.raises(AnalysisError, match=r"not measured: two sequences agree on .*, .* ns alike: more light"):
            delay(twin(1, rf_gain=0.3))


class TestFaults:
    """What is wrong is said in one line, and what can still be measured is."""

    def test_no_light_ends_what_needs_light_and_the_command_fails(self, tmp_path: Path) -> None:
        directory = tmp_path / "dark"
        station = "[sim]\nparameters = { laser_tuning_s = 0.0, fibre_loss_db = 80.0 }\n"
        status, found, lines = command_line(station, directory)
        assert status == 1
        no_light = "no light: check the laser's shutter, the fibre into this detector and its patching"
        assert sum(line.endswith(f"{no_light}, and that the DMD shows its pictures") for line in lines) == 4
        assert "delay: not measured: no light on any channel" in lines
        assert not found["good"]
        assert [finding["good"] for finding in found["findings"][:8]] == [True] * 8
        assert not json.loads(Path(found["calibration"]).read_text("utf-8"))["good"]
        status, found, _ = command_line("", directory)
        assert (status, found["error"]) == (2, f"{directory}: is not empty: name a new directory")

    def test_a_recording_is_no_calibration_of_the_bench(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        station, recording = tmp_path / "dark.toml", tmp_path / "dark.rec"
        station.write_text("[sim]\nparameters = { laser_tuning_s = 0.0, fibre_loss_db = 80.0 }\n", encoding="utf-8")
        status, out, _ = labctl(capsys, "record", recording, "--", "align", "--station", station)
        assert (status, "calibration, not good" in out) == (1, True)
        measured = newest(read_station(station), datetime.now(UTC))
        again = tmp_path / "again"
        status, out, err = labctl(capsys, "replay", recording, "--", "align", "--station", station, "--out", again)
        assert (status, "replay: " in err) == (1, False)
        assert "\nno calibration: a recording answered, and says nothing of the bench as it is now\nreport: " in out
        assert " UTC, of a recording" in (again / "report.html").read_text("utf-8")
        assert not (again / "calibration.json").exists()
        assert measured is not None
        assert newest(read_station(station), datetime.now(UTC)) == measured

    def test_a_laser_that_does_not_obey_after_a_stop_is_an_error(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(_laser: Tlg220) -> None:
            raise InstrumentError("laser: does not obey")

        interruption = Interruption()

        def stop(finding: Finding) -> None:
            monkeypatch.setattr(Tlg220, "darken", refuse)
            interruption.requested = finding.step == "range"

        directory, station = tmp_path / "stopped", twin(1)
        with held(station, "a test") as hold, pytest.raises(UnsafeBench, match="the laser may still emit"):
            align_bench(station, Access(), hold, directory=directory, interruption=interruption, tell=stop)

    def test_a_full_disk_is_said_before_there_is_light(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("labctl.runs.write.room._free", lambda _directory: 1_000_000)
        status, found, lines = command_line("", tmp_path / "full")
        assert (status, lines) == (2, [f"labctl: {found['error']}"])
        assert re.fullmatch(r".*full: up to 16 MB are needed and the disk has 1 MB free: make room, .*", found["error"])
        assert not any((tmp_path / "full").iterdir())

    def test_no_trigger_is_said_and_nothing_is_kept(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("instruments.tektronix_dpo72504dx.TRIGGER_WAIT_S", 0.2)
        station = twin(1)
        deaf = station.model_copy(update={"scope": station.scope.model_copy(update={"trigger_level": 2.5})})
        found = aligned(deaf, tmp_path / "deaf")
        assert found.calibration is None
        first = found.findings[0].line()
        assert first.startswith("dark: not measured: scope at ")
        assert "no trigger came within 0.2 s: check that the AWG plays, the trigger's cable and its level" in first
        assert len(found.findings) == 7
        assert found.report.exists()

    @pytest.mark.parametrize(
        ("parameters", "limit_v", "said"),
        [
            ({"detector_limit_v": 0.04}, 1.5, "flat at 4"),
            ({"detector_limit_v": 20.0, "detector_gain_v_per_w": 3e4}, 30.0, "the coarsest range: attenuate the light"),
        ],
        ids=["detector", "digitiser"],
    )
    def test_too_much_light_is_said_and_nothing_is_read_from_what_is_cut(
        self, parameters: dict[str, Any], limit_v: float, said: str, tmp_path: Path
    ) -> None:
        """A detector that gives 40 mV at most, below the images' 100 mV; and light beyond the coarsest range."""
        station = twin(1, **parameters)
        station = station.model_copy(update={"limits": station.limits.model_copy(update={"detector": limit_v})})
        found = aligned(station, tmp_path / "bright")
        ranges = [finding for finding in found.findings if finding.step == "range"]
        assert any(said in finding.line() for finding in ranges)
        assert not found.good
        late = [finding.line() for finding in found.findings if finding.step == "delay"]
        assert len(late) == 1
        assert "not measured: mend channel " in late[0]
        assert found.calibration is not None
        assert not json.loads(found.calibration.read_text("utf-8"))["good"]

    def test_a_drive_that_does_not_arrive_is_no_fault_of_the_detectors(self, tmp_path: Path) -> None:
        found = aligned(twin(2, rf_gain=1e-6), tmp_path / "still")
        told = [finding.line() for finding in found.findings]
        assert not any("flat at" in line for line in told)
        assert any("the light does not follow the drive: check modulator and RF amplifier" in line for line in told)
        assert any("below 10 dB: more light, or check modulator and RF amplifier" in line for line in told)
        assert all(int(count) <= MOST_AVERAGES for line in told for count in re.findall(r"averages=(\d+)", line))

    @pytest.mark.full
    def test_a_fibre_in_the_wrong_port_leaves_its_channel_dark_and_the_others_well(self, tmp_path: Path) -> None:
        """Port 10 is where light enters the chip: none comes out of it."""
        station = twin(1)
        panel = station.patch_panel.model_copy(update={"ports": (0, 1, 10, 3, 4)})
        found = aligned(station.model_copy(update={"patch_panel": panel}), tmp_path / "aligned")
        named = {finding.channel for finding in found.findings if "no light" in finding.advice}
        assert named == {2}
        assert not found.good
        assert {finding.channel for finding in found.findings if finding.step == "repeatability"} == {1, 3, 4}
        assert all(finding.estimate is not None for finding in found.findings)

    def test_noise_of_a_record_that_clips_is_a_bound(self) -> None:
        volts = np.clip(np.random.default_rng(1).normal(0, [[3e-2], [1e-3], [1e-3]], (8, 3, 50)), -31e-3, 31e-3)
        volts[:, 1] = 31e-3
        noises = of_dark(Dark(volts, np.array([True, True, False])), (1, 2, 4)).findings[1::2]
        bound = "at least that, since the record clips: "
        assert noises[0].advice == f"{bound}more than 5 mV: check the detector's supply and its cable"
        assert noises[1].advice == f"{bound}mend the dark level first"
        assert noises[2].good

    def test_a_detector_that_does_not_pass_dc_is_told_from_one_without_light(self) -> None:
        generator = np.random.default_rng(1)
        dark = Dark(generator.normal(0, 1e-3, (8, 1, 50)), np.zeros(1, np.bool_))
        volts = np.tile(generator.exponential(0.05, (1, 6, 1, 50)), (2, 1, 1, 1))
        volts -= volts.mean()
        no = np.zeros(1, np.bool_)
        (found,) = of_range(Ranged(volts, no, np.ptp(volts) / 0.75 + no, no, no), dark, (1,), projector=True).findings
        assert found.advice == "goes below the dark level, as no light does: check that the detector passes DC"

    def test_a_dark_channel_and_one_that_clips_are_named(self) -> None:
        generator = np.random.default_rng(1)
        dark = Dark(generator.normal(0, 1e-3, (8, 3, 50)), np.zeros(3, np.bool_))
        volts = np.tile(generator.exponential(0.05, (1, 6, 3, 50)), (2, 1, 1, 1)) + generator.normal(
            0, 1e-4, (2, 6, 3, 50)
        )
        volts[:, :, 1] = generator.normal(0, 1e-4, (2, 6, 50))
        no = np.zeros(3, np.bool_)
        full = np.array([np.ptp(volts[:, :, 0]) / 0.75, 0.0625, np.ptp(volts[:, :, 2])])
        piece = Ranged(volts, np.array([False, False, True]), full, no, no)
        result = of_range(piece, dark, (1, 2, 4), projector=True)
        assert not result.ends
        good, lightless, clipped = (finding.line() for finding in result.findings)
        assert good.endswith("%: good (60 % at least, not cut)")
        assert "channel 2: " in lightless
        assert lightless.endswith("no light: check the laser's shutter, the fibre into this detector and its patching")
        assert "channel 4: " in clipped
        assert "clips at " in clipped
        assert "lower the gain or the light" in clipped
