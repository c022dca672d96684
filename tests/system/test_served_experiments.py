"""Experiments on a bench that another process serves: the frames are those of the same twin in this process."""

import json
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from instruments.interfaces import PatchPanel, TunableLaser
from labctl.bench.opening import opened
from labctl.bench.signals import Interruption
from labctl.bench.station import Station, WiringSection, read_station, write_addresses
from labctl.engine.engine import carry_out
from labctl.engine.plan import Request
from labctl.engine.session import Acquisition, acquire
from labctl.runs.live.logs import CommandLog
from labctl.runs.read.run import open_run
from labctl.studies.paper.experiments import experiments
from labctl.studies.paper.reproduction import Plan, reproduce
from labctl.studies.tasks import Interrupted
from protocols.base import Sequences
from protocols.sequence_readout import SequenceReadout

TWIN = 2

STILL = """
title = "Few images"
paper = ""
statement = ""
analysis = "traces"
splits = 1

[runs.input]
protocol = "image-readout"
settings = { averages = 2, images = 4, ports = "0", window = "0.8 ns", reference_every = 1 }

[runs.chip]
protocol = "image-readout"
settings = { averages = 2, images = 4, ports = "2,3", window = "0.8 ns", reference_every = 1 }
"""
"""Like fig2, but so small that it takes a second."""

FEW = ("scenes=1", "images=40", "averages=2", "switch_after=0.5 us", "window=1 us")
SCENE = ("ports=2", *FEW)

BY_HAND = Station(
    laser={"driver": "manual-laser"},
    patch_panel={"driver": "manual-patch-panel"},
    wiring=WiringSection(burst=True),
)


@dataclass
class Operator:
    """Somebody who does what is asked, on the bench itself."""

    laser: TunableLaser
    patch_panel: PatchPanel
    asked: int = 0

    def __call__(self, request: str) -> str:
        self.asked += 1
        if wavelength := re.search(r"to ([0-9.]+) nm", request):
            self.laser.tune(float(wavelength[1]))
        elif power := re.search(r"to ([0-9.]+) mW", request):
            self.laser.set_power(float(power[1]) / 1e3)
        elif "ON" in request:
            self.laser.emit()
        elif "OFF" in request:
            self.laser.darken()
        else:
            assert self.laser.settings()["emitting"] == 0, "a person moves fibres in the light"
            pairs = re.findall(r"port (\d+) to CH(\d)", request)
            self.patch_panel.connect({int(channel): int(port) for port, channel in pairs})
        return ""


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory, labctl_command: tuple[str, ...]) -> Iterator[Path]:
    """Two processes that serve benches, one cabled as for images, one for time series; and their station files."""
    folder = tmp_path_factory.mktemp("served")
    options = {"projector.toml": "--projector", "straight.toml": "--no-projector"}
    by_state = folder / "by-state.toml"
    by_state.write_text("[wiring]\nburst = true\n[sim]\nnoise = 'by-state'\n", encoding="utf-8")
    serve = (*labctl_command, "sim", "serve", "--json", "--twin-seed", str(TWIN), "--station", str(by_state))
    commands = [(*serve, option, "--save-station", str(folder / name)) for name, option in options.items()]
    with ExitStack() as stack:
        servers = [stack.enter_context(subprocess.Popen(one, stdout=subprocess.PIPE, text=True)) for one in commands]
        try:
            for server in servers:
                assert server.stdout is not None
                assert json.loads(server.stdout.readline())["resources"]
            yield folder
        finally:
            for server in servers:
                server.send_signal(signal.SIGTERM)
    assert [server.returncode for server in servers] == [0, 0]


@pytest.fixture
def station(benches: Path) -> Path:
    """A served bench with fibre and DMD in the light's way."""
    return benches / "projector.toml"


@pytest.fixture
def straight(benches: Path) -> Path:
    """A served bench whose light goes from the modulator straight into the chip."""
    return benches / "straight.toml"


def test_the_saved_station_says_how_the_bench_is(station: Path, straight: Path) -> None:
    assert read_station(station).sim.twin_seed == read_station(straight).sim.twin_seed == TWIN
    assert read_station(station).wiring.projector
    assert not read_station(straight).wiring.projector


def test_an_experiment_on_a_served_bench_measures_the_frames_of_its_twin(
    station: Path, tmp_path: Path, labctl: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.toml").write_text(STILL, encoding="utf-8")
    monkeypatch.setattr("labctl.commands.reproduce.experiments", partial(experiments, folder=tmp_path))
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    _, far = labctl("reproduce", "mine", "--seeds", 2, "--station", station, "--out", tmp_path / "far")
    assert (far["seeds"], far["benches"]) == (2, 1)
    assert "One bench for every seed" in (tmp_path / "far" / "report.html").read_text("utf-8")
    near = read_station(twin_in_process(tmp_path))
    (experiment,) = experiments(["mine"], folder=tmp_path)
    asked = [
        protocol.model_copy(update={"seed": seed, "timing": "burst"})
        for seed in (1, 2)
        for protocol in experiment.protocols.values()
    ]
    for number, (protocol, run) in enumerate(zip(asked, far["runs"], strict=True)):
        acquired = acquire(Acquisition(protocol, near, tmp_path / f"near-{number}"))
        assert frames(acquired.outcome.directory) == frames(run)


def test_an_operator_patches_and_switches_at_the_terminal(
    station: Path, tmp_path: Path, labctl: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The person is a second client, who does what is asked at the instruments that labctl is not told of."""
    (tmp_path / "mine.toml").write_text(STILL, encoding="utf-8")
    monkeypatch.setattr("labctl.commands.reproduce.experiments", partial(experiments, folder=tmp_path))
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    lab = read_station(station)
    by_hand = tmp_path / "by-hand.toml"
    addresses = {name: address for name, address in lab.addresses.items() if name in ("awg", "scope", "dmd")}
    write_addresses(by_hand, addresses, BY_HAND)
    with CommandLog() as log, opened(lab, log) as found:
        operator = Operator(found.bench.laser, found.bench.patch_panel)
        monkeypatch.setattr("labctl.bench.opening.ask_operator", operator)
        words = ("reproduce", "mine", "--seeds", 1, "--station", by_hand)
        status, refused = labctl(*words, "--out", tmp_path / "alone")
        assert (status, operator.asked) == (2, 0)
        assert "repeat with --attended" in refused["error"]
        _, done = labctl(*words, "--out", tmp_path / "hand", "--attended")
    near = read_station(twin_in_process(tmp_path))
    (experiment,) = experiments(["mine"], folder=tmp_path)
    for name, protocol in experiment.protocols.items():
        burst = protocol.model_copy(update={"timing": "burst"})
        acquired = acquire(Acquisition(burst, near, tmp_path / f"near-{name}"))
        assert frames(acquired.outcome.directory) == frames(done["runs"][list(experiment.protocols).index(name)])


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        (("run", "image-readout", "--set", "images=4", "--set", "ports=0,2-6", "--set", "reference_every=1"), 3),
        (("run", "dynamic-scene", "--set", "ports=2-6", *(word for one in FEW for word in ("--set", one))), 2),
        (("live", "--ports", "2", "--for", "0.1 s"), 1),
    ],
    ids=["stills", "scenes", "view"],
)
def test_no_light_is_on_while_somebody_moves_fibres(
    words: tuple[str, ...], asked: int, station: Path, tmp_path: Path, labctl: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab = read_station(station)
    by_hand = tmp_path / "by-hand.toml"
    addresses = {name: address for name, address in lab.addresses.items() if name != "patch_panel"}
    panel = {"driver": "manual-patch-panel", "ports": lab.patch_panel.ports}
    write_addresses(by_hand, addresses, Station(patch_panel=panel, wiring=WiringSection(burst=True)))
    monkeypatch.chdir(tmp_path)
    with CommandLog() as log, opened(lab, log) as found:
        operator = Operator(found.bench.laser, found.bench.patch_panel)
        monkeypatch.setattr("labctl.bench.opening.ask_operator", operator)
        status, _ = labctl(*words, "--station", by_hand)
        assert (status, operator.asked) == (0, asked)
        assert found.bench.laser.settings()["emitting"] == 0


def test_interrupted_before_its_first_shot_it_ends_there_and_begins_no_other_run(station: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(STILL, encoding="utf-8")
    plan = Plan(experiments(["mine"], folder=tmp_path), read_station(station), tmp_path / "out")
    interrupted(plan)
    (begun,) = (tmp_path / "out").iterdir()
    with open_run(begun) as stored:
        assert sum(stored.done) == 0
    with CommandLog() as log, opened(read_station(station), log) as found:
        assert found.bench.laser.settings()["emitting"] == 0


def test_uploads_to_the_one_bench_are_told(station: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(STILL, encoding="utf-8")
    plan = Plan(experiments(["mine"], folder=tmp_path), read_station(station), tmp_path / "out")
    stopped, told = Interruption(), []

    def tell(what: str, done: int, total: int) -> None:
        told.append((what, done == total))
        stopped.requested = what == "waveform"

    with pytest.raises(Interrupted):
        reproduce(plan, interruption=stopped, progress=lambda *_: None, uploading=tell)
    assert told[-1] == ("waveform", True)


def test_a_scene_on_a_served_bench_has_the_frames_of_its_twin(station: Path, tmp_path: Path, labctl: Any) -> None:
    few = [word for one in SCENE for word in ("--set", one)]
    near, far, again = (
        labctl("run", "dynamic-scene", *few, "--station", where, "--out", tmp_path / name)[1]["frames_sha256"]
        for name, where in (("near", twin_in_process(tmp_path)), ("far", station), ("again", station))
    )
    assert near == far == again


def test_a_sequence_on_a_served_bench_has_the_frames_of_its_twin(straight: Path, tmp_path: Path) -> None:
    values = np.random.default_rng(5).uniform(size=(3, 10))
    inputs = Sequences(values, np.array([0, 1, 0]), np.arange(3), np.arange(3))
    protocol = SequenceReadout(ports=(2, 3), averages=2, wavelengths=(1550.0, 1551.0))
    digests = []
    for name, where in (("near", twin_in_process(tmp_path, projector=False)), ("far", straight)):
        with CommandLog() as log, opened(read_station(where), log) as found:
            request = Request(protocol, inputs, read_station(where))
            outcome = carry_out(request, found.bench, Interruption(), tmp_path / name)
        digests.append(frames(outcome.directory))
    assert digests[0] == digests[1]


def test_a_served_bench_that_is_cabled_otherwise_is_refused(straight: Path, tmp_path: Path, labctl: Any) -> None:
    status, shown = labctl("reproduce", "fig3", "--station", straight, "--out", tmp_path / "out")
    assert status == 2
    assert "set wiring.projector = true" in shown["error"]
    assert not (tmp_path / "out").exists()


def interrupted(plan: Plan) -> None:
    """Carry out `plan` and stop it before its first shot."""
    with pytest.raises(Interrupted):
        reproduce(plan, interruption=Interruption(requested=True), progress=lambda *_: None)


def twin_in_process(folder: Path, *, projector: bool = True) -> Path:
    """A station file of the same twin in this process, every burst cable there."""
    path = folder / "near.toml"
    wiring = f"[wiring]\nburst = true\nprojector = {str(projector).lower()}\n"
    path.write_text(f"{wiring}[sim]\ntwin_seed = {TWIN}\nnoise = 'by-state'\n", encoding="utf-8")
    return path


def frames(run: str | Path) -> str:
    """Digest of all frames of a run."""
    with open_run(run) as stored:
        return stored.digest()
