"""`labctl show`: pictures and numbers of a run, a summary of other files, a clear refusal of the rest."""

import errno
from importlib.resources import files
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image

from labctl.runs.read.run import open_run
from labctl.studies.inspection import cannot_be_drawn
from tests.checkout import ROOT
from tests.labctl.commands.conftest import AsJson, Typed

RECORDING = Path(__file__).parents[1] / "bench" / "recording" / "check.rec"


def test_a_run_is_drawn_and_summed_up(bench_run: Path, as_json: AsJson) -> None:
    status, found = as_json("show", bench_run)
    assert status == 0
    names = ("traces", "images", "codes", "drift")
    assert found["pictures"] == [str(bench_run / "figures" / f"shown-{name}.png") for name in names]
    assert found["left_out"] == []
    for picture in found["pictures"]:
        with Image.open(picture) as image:
            assert len(image.convert("L").getcolors(1 << 16) or []) > 2
    with open_run(bench_run) as run:
        assert found["frames_sha256"] == run.digest()
        levels = run.volts(run.shots["kind"] == "reference").mean(axis=2)
        for place, port in enumerate(found["signals"]):
            codes = run.frames[:, place]
            assert port["port"] == f"port {run.ports[place]}"
            assert port["clipped_fraction"] == run.clipped[:, place].mean()
            assert port["range_used"] == (int(codes.max()) - int(codes.min()) + 1) / 256
            assert port["reference_level_v"]["last"] == pytest.approx(levels[-1, place])
            assert abs(port["reference_correlation"]) <= 1 + 1e-9


def test_some_shots_and_ports_in_one_picture(bench_run: Path, tmp_path: Path, typed: Typed) -> None:
    out = tmp_path / "look.png"
    status, told, _ = typed("show", bench_run / "data.h5", "--out", out, "--shots", "3-5", "--ports", "3")
    assert status == 0
    assert [path.name for path in tmp_path.iterdir()] == ["look.png"]
    with Image.open(out) as image:
        assert image.width > 500
    assert str(out) in told
    assert "port 3" in told
    assert "port 2" not in told
    assert "drift is left out: it is seen in two or more reference images" in told


def test_the_file_of_a_protocol_is_not_in_the_table(tmp_path: Path, as_json: AsJson, typed: Typed) -> None:
    own = ROOT / "docs" / "how-to" / "examples" / "bench_extras.py"
    assert typed("run", own, "--set", "repeats=2", "--set", "ports=2", "--out", tmp_path / "run")[0] == 0
    table = typed("show", tmp_path / "run")[1]
    assert "protocol.file.sha256" in table
    assert "import" not in table
    assert as_json("show", tmp_path / "run")[1]["protocol"]["file"]["text"] == own.read_text("utf-8")


def test_channels_of_different_wavelengths_have_different_names(tmp_path: Path, typed: Typed, as_json: AsJson) -> None:
    scan = ("wavelength-scan", "--set", "steps=3", "--set", "images=4", "--set", "step=0.5 pm")
    assert (
        "labctl: built-in station: 1527.9995 nm are asked for, "
        in typed("run", *scan, "--set", "start=1527.9995 nm")[2]
    )
    assert "1550, 1550.0005, 1550.001 nm" in typed("run", *scan, "--dry-run")[1]
    table = (files("sim_backends.virtual.tlg220") / "commands.toml").read_text("utf-8")
    (tmp_path / "fine.toml").write_text(table.replace("step = 0.001", "step = 0.0005"), "utf-8")
    (tmp_path / "bench.toml").write_text("[laser]\ncommands = 'fine.toml'\n", "utf-8")
    assert typed("run", *scan, "--station", tmp_path / "bench.toml", "--out", tmp_path / "scan")[0] == 0
    named = [channel["port"] for channel in as_json("show", tmp_path / "scan")[1]["signals"]]
    assert named == [f"before the chip, {wavelength} nm" for wavelength in ("1550", "1550.0005", "1550.001")]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--shots", "5-3"), "is not a range of shots"),
        (("--shots", "5-"), "is not a range of shots"),
        (("--shots", "90"), "it has shots 0 to 27"),
        (("--ports", "4"), "port 4 was not measured: choose from 2, 3"),
        (("--ports", "two"), "is not a list of ports"),
        (("--ports", "3-2"), "is not a list of ports"),
        (("--ports", "2,2"), "(2, 2) names one twice: list each once"),
        (("--out", "/dev/null/here"), "name another place by --out"),
    ],
)
def test_what_cannot_be_shown_is_told_in_one_line(
    bench_run: Path, options: tuple[str, ...], message: str, typed: Typed
) -> None:
    status, out, told = typed("show", bench_run, *options)
    assert (status, out) == (2, "")
    assert message in told
    assert told.count("\n") == 1


def test_pictures_of_a_run_of_somebody_else_may_go_elsewhere() -> None:
    told = str(cannot_be_drawn(Path("theirs/figures"), PermissionError(errno.EACCES, "Permission denied")))
    assert told.startswith("theirs/figures: cannot be written (Permission denied): use a place that is yours")
    assert told.endswith(", or name another place by --out")


def test_other_files_say_what_they_are(tmp_path: Path, as_json: AsJson) -> None:
    (tmp_path / "bench.toml").write_text("[sim]\ntwin_seed = 4\n", encoding="utf-8")
    (tmp_path / "few.toml").write_text('protocol = "image-readout"\n[settings]\nimages = 40\n', encoding="utf-8")
    status, found = as_json("show", tmp_path / "bench.toml")
    assert (status, found["sim"]["twin_seed"]) == (0, 4)
    status, found = as_json("show", tmp_path / "few.toml")
    assert (status, found["protocol"], found["settings"]["images"]) == (0, "image-readout", 40)
    status, found = as_json("show", RECORDING)
    assert (status, found["complete"]) == (0, True)
    assert sum(one["sent"] for one in found["connections"].values()) > 10


def test_files_that_nobody_knows_are_refused(tmp_path: Path, typed: Typed) -> None:
    (tmp_path / "drive.wfmx").write_text('<DataFile offset="000001000" version="0.1">', encoding="utf-8")
    (tmp_path / "broken.toml").write_text("[sim\n", encoding="utf-8")
    with h5py.File(tmp_path / "export.nc", "w") as file:
        file.attrs["_NCProperties"] = "version=2"
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros(3)
    for name, message in (
        ("drive.wfmx", "is nothing that can be shown: name a run directory"),
        ("other.h5", "is nothing that can be shown"),
        ("broken.toml", "is not TOML"),
        ("export.nc", "is a netCDF file: open it with xarray.open_dataset"),
    ):
        status, out, told = typed("show", tmp_path / name)
        assert (status, out, told.count("\n")) == (2, "", 1)
        assert message in told
    status, _, told = typed("show", tmp_path / "export.nc", "--shots", "3")
    assert "is not a run" in told
