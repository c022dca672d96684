"""From a wavelength scan to the fibre: through the instruments, and the commands on runs of every kind."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from instruments.values import Drive, Frames
from labctl.bench.station import SimSection, Station
from labctl.commands.evaluate import evaluate
from labctl.commands.exit_status import DONE
from labctl.commands.next_steps import next_command
from labctl.commands.report import report
from labctl.commands.train import train
from labctl.engine.session import Acquisition, acquire
from labctl.errors import AnalysisError, RunError, UsageError
from labctl.runs.format.columns import shot_table
from labctl.runs.format.shape import RunShape
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter
from labctl.studies.fibre import in_words, measure_fibre
from protocols.wavelength_scan import WavelengthScan
from sim_backends.parameters import Parameters
from tests.labctl.studies.alignment.world_truth import half_width_m

STEP_NM = 0.002


@pytest.fixture(scope="module")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan of four half widths on the simulated bench, whose laser tunes at once."""
    directory = tmp_path_factory.mktemp("runs") / "scan"
    station = Station(sim=SimSection(parameters={"laser_tuning_s": 0.0}))
    acquire(Acquisition(WavelengthScan(steps=14), station, directory))
    return directory


def stored(
    directory: Path, codes: NDArray[np.integer], *, protocol: object = None, ports: tuple[int, ...] = (0,)
) -> Path:
    """A finished run of `codes` (wavelengths, images, ports, samples), as images at wavelengths 2 pm apart."""
    wavelengths, images = codes.shape[:2]
    shape = RunShape(
        images,
        (ports,) * wavelengths,
        codes.shape[3],
        40e-12,
        "int16",
        wavelengths_nm=tuple(np.round(1550 + STEP_NM * np.arange(wavelengths), 6).tolist()),
    )
    numbers = np.arange(images)
    plan = shot_table(
        kind=np.full(images, "image"),
        dataset_index=numbers,
        label=numbers % 2,
        wavelength_nm=np.full(images, 1550.0),
        group=numbers,
    )
    manifest = {"protocol": {"name": "wavelength-scan"} if protocol is None else protocol}
    drive = Drive("drive", np.zeros(50, np.float32), 25e9, 0.5)
    with RunWriter.create(directory, manifest, shape, plan, drive, Durability(shots=100, seconds=3600)) as writer:
        for pass_ in range(wavelengths):
            writer.scales(pass_, np.full(len(ports), 1e-3), np.zeros(len(ports)))
            none = np.zeros(codes[pass_].shape[:2])
            frames = Frames(codes[pass_].astype(np.int16), none, np.zeros(images), none.astype(bool))
            writer.append(pass_, 0, frames)
    return directory


def fading(alike: float, wavelengths: int = 12, ports: int = 1) -> NDArray[np.int64]:
    """Traces (wavelengths, 4, ports, 200) whose correlation is `alike` to the power of the steps between them."""
    generator = np.random.default_rng(1)
    fresh = generator.normal(size=(wavelengths, 4, ports, 200))
    traces = [fresh[0]]
    for one in fresh[1:]:
        traces.append(alike * traces[-1] + np.sqrt(1 - alike**2) * one)
    codes: NDArray[np.int64] = np.rint(1000 * np.array(traces)).astype(np.int64)
    return codes


class TestOnTheSimulatedBench:
    def test_the_half_width_is_that_of_the_fibre(self, scanned: Path) -> None:
        """Within three standard deviations of what this twin's own modes give, each with its power and delay.

        The standard deviation is that of the measured width, and 5 % for images, which weigh modes each in its way.
        """
        expected_nm = 1e9 * half_width_m(Parameters(), 1)
        found = measure_fibre(scanned)
        assert found["verdict"] == "measured"
        uncertainty_nm = found["half_width_uncertainty_nm"]
        assert uncertainty_nm < 0.4 * expected_nm
        allowed_nm = 3 * np.hypot(uncertainty_nm, 0.05 * expected_nm)
        assert found["half_width_nm"] == pytest.approx(expected_nm, abs=allowed_nm)

    def test_a_scan_begins_where_it_is_said_to(self, scanned: Path) -> None:
        later = in_words(measure_fibre(scanned) | {"centre_nm": 1550.015})
        assert "on port 0, 1550.002 nm to 1550.028 nm in steps of 2 pm" in later[0]

    def test_evaluate_says_it_in_units(self, scanned: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert evaluate(scanned) == DONE
        out = capsys.readouterr().out
        assert "intensity correlation of 8 images on port 0, 1550 nm to 1550.026 nm in steps of 2 pm" in out
        assert "half width at half maximum: " in out
        assert " pm (" in out
        assert "delay spread L NA²/(2 n c) of the modes that the images light: " in out
        assert f"report: {scanned / 'report.html'}" in out

    def test_evaluate_prints_one_object_for_scripts(self, scanned: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert evaluate(scanned, as_json=True) == DONE
        found = json.loads(capsys.readouterr().out)
        assert found["detuning_nm"] == pytest.approx(STEP_NM * np.arange(14))
        assert found["correlation"][0] == 1
        assert len(found["correlation"]) == 14
        assert found["what_to_do"] is None

    def test_report_draws_it(self, scanned: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert report(scanned, as_json=True) == DONE
        found = json.loads(capsys.readouterr().out)
        made = {"report": str(scanned / "report.html"), "figures": str(scanned / "figures")}
        assert found == {"run": str(scanned), "protocol": "wavelength-scan"} | made
        words = (scanned / "figures" / "correlation.svg").read_text("utf-8")
        for text in ("detuning (pm)", "correlation (1 = same)", "measured, 8 images", "Gaussian launch", "half width"):
            assert text in words
        first = Path(found["report"]).read_bytes()
        assert report(scanned) == DONE
        assert capsys.readouterr().out.splitlines()[0] == found["report"]
        assert Path(found["report"]).read_bytes() == first


class TestWhatAScanCannotTell:
    @pytest.mark.parametrize(
        ("alike", "wavelengths", "message"),
        [
            (0.3, 12, "too coarse: less than one half is left after one step of 2 pm; measure again with --set step='"),
            (
                0.99,
                12,
                "too short: the correlation stays above one half, the scan spans 22 pm; measure again with --set",
            ),
            (0.9, 9, "too short: the correlation falls to one half only "),
        ],
    )
    def test_is_said_with_what_to_do(
        self, alike: float, wavelengths: int, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        run = stored(tmp_path / "run", fading(alike, wavelengths))
        assert evaluate(run) == DONE
        assert f"not known, the scan is {message}" in capsys.readouterr().out
        found = measure_fibre(run)
        assert (found["half_width_nm"], found["half_width_hz"], found["delay_spread_s"]) == (None, None, None)
        assert "one half" in (run / "figures" / "correlation.svg").read_text("utf-8")

    def test_behind_the_chip_no_delay_spread_is_named(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        run = stored(tmp_path / "run", fading(0.8, 14, ports=2), ports=(2, 3))
        assert evaluate(run) == DONE
        out = capsys.readouterr().out
        assert "on port 2, 3" in out
        assert "port 0 shows the fibre alone" in out
        assert "delay spread" not in out

    def test_a_run_at_one_wavelength_is_no_scan(self, tmp_path: Path) -> None:
        run = stored(tmp_path / "run", fading(0.9, 1))
        with pytest.raises(AnalysisError, match="not measured at evenly spaced wavelengths: 'labctl run wavelength"):
            measure_fibre(run)


class TestOtherRuns:
    """One line that says what to type."""

    @pytest.mark.parametrize("command", [evaluate, report])
    @pytest.mark.parametrize(
        ("protocol", "message"),
        [
            ({"name": "dynamic-scene"}, "judged by an experiment, .* go on with 'labctl reproduce fig4"),
            ({"name": "sequence-readout"}, "judged by an experiment, .* go on with 'labctl reproduce s2 s3'"),
            ({"name": "image-readout"}, "judged with a readout: go on with 'labctl train "),
            ({"name": "of-a-plug-in"}, "nothing that labctl can judge: go on with 'labctl show "),
            ("synthetic", "unknown protocol is nothing that labctl can judge"),
        ],
    )
    def test_that_are_not_judged_by_themselves(
        self, command: Callable[[Path], int], protocol: object, message: str, tmp_path: Path
    ) -> None:
        run = stored(tmp_path / "run", fading(0.5, 1), protocol=protocol)
        before = sorted(run.iterdir())
        with pytest.raises(UsageError, match=message) as told:
            command(run)
        assert "\n" not in str(told.value)
        assert sorted(run.iterdir()) == before

    @pytest.mark.parametrize(
        ("protocol", "message"),
        [("dynamic-scene", "labctl reproduce"), ("wavelength-scan", "without a readout: go on with 'labctl evaluate ")],
    )
    def test_a_readout_of_still_images_does_not_fit(self, protocol: str, message: str, tmp_path: Path) -> None:
        run = stored(tmp_path / "run", fading(0.5, 2), protocol={"name": protocol})
        with pytest.raises(UsageError, match=message):
            evaluate(tmp_path / "model.h5", run)
        with pytest.raises(UsageError, match=message):
            train(run)

    def test_a_readout_that_is_there_is_named(self, tmp_path: Path) -> None:
        run = stored(tmp_path / "run", fading(0.5, 2), protocol={"name": "image-readout"})
        model = run / "models" / "softmax.h5"
        model.parent.mkdir()
        model.touch()
        assert next_command(run) == f"labctl evaluate {model} {run}"

    def test_a_run_of_one_class_can_be_looked_at(self, tmp_path: Path) -> None:
        """No readout learns anything from it, however many more of its images there are."""
        run = stored(tmp_path / "run", fading(0.5, 2)[:, ::4], protocol={"name": "image-readout"})
        assert next_command(run) == f"labctl show {run}"
        with pytest.raises(UsageError, match=r"by --set classes=\): go on with 'labctl show "):
            evaluate(run)

    def test_a_file_of_a_run_is_not_the_run(self, tmp_path: Path) -> None:
        run = stored(tmp_path / "run", fading(0.5, 2), protocol={"name": "image-readout"})
        told = rf"data\.h5: is a file: name the run directory, {run} if that is it$"
        with pytest.raises(UsageError, match=told):
            evaluate(tmp_path / "model.h5", run / "data.h5")
        with pytest.raises(UsageError, match=told):
            report(run / "data.h5")

    def test_a_protocol_of_ones_own_says_itself_how_it_is_judged(self, tmp_path: Path) -> None:
        run = stored(tmp_path / "run", fading(0.5, 2), protocol={"name": "mine", "judgement": "readout"})
        assert next_command(run) == f"labctl train {run}"

    def test_a_model_goes_to_the_readout(self, tmp_path: Path) -> None:
        with pytest.raises(AnalysisError, match=r"nowhere\.h5"):
            evaluate(Path("nowhere.h5"), stored(tmp_path / "run", fading(0.5, 1), protocol={"name": "image-readout"}))

    def test_what_is_no_run(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="no such directory"):
            evaluate(tmp_path / "nowhere")
        (tmp_path / "model.h5").touch()
        with pytest.raises(UsageError, match="name the run directory after it"):
            evaluate(tmp_path / "model.h5")
        with pytest.raises(RunError, match="not a run directory"):
            report(tmp_path)

    def test_after_a_scan_it_is_evaluated(self, tmp_path: Path) -> None:
        run = stored(tmp_path / "my fibre", fading(0.5, 2), protocol={"name": "wavelength-scan"})
        assert next_command(run) == f"labctl evaluate '{run}'"
