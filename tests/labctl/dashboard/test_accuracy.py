"""Accuracy as a run grows, and what is asked of the form that starts one."""

from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import pytest

from labctl.bench.station import Station
from labctl.commands.main import main
from labctl.dashboard import launcher
from labctl.dashboard.accuracy import LEAST, Curve, counts, curve
from labctl.dashboard.launcher import Asked, to_resume
from labctl.dashboard.learning import Learning, _subject
from labctl.dashboard.monitor import Watching
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout
from tests.system.waiting import until


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("runs") / "run"
    acquire(Acquisition(ImageReadout(images=60, window=0.8e-9, ports=(2, 3)), Station(), directory))
    return directory


def whole_curve(directory: Path, known: Curve) -> Curve:
    follows = True
    while follows:
        known, follows = curve(directory, known)
    return known


def test_the_points_lie_ever_further_apart() -> None:
    assert counts(LEAST - 1) == []
    assert counts(100) == [40, 52, 68, 88]


def test_a_curve_says_the_same_however_often_it_is_computed(run: Path) -> None:
    whole = whole_curve(run, Curve())
    assert whole.images == (40, 52, 60), "the last point is that of all images"
    assert whole.ports == (2, 3)
    assert whole.chance == pytest.approx(0.25)
    assert all(0.25 < accuracy <= 1 for accuracy in whole.accuracy)
    begun = Curve(whole.images[:1], whole.accuracy[:1], whole.ports, whole.chance, LEAST)
    assert whole_curve(run, begun) == whole
    assert whole_curve(run, Curve((40,), (0.0,), (7,))) == whole, "points on other ports are no points"


def test_a_run_without_classes_or_none_at_all_has_no_points(tmp_path: Path) -> None:
    assert curve(tmp_path / "nothing", Curve()) == (Curve(), False)


def test_a_step_is_one_point_and_the_last_says_that_none_follows(run: Path) -> None:
    known, steps = Curve(), []
    for _ in range(4):
        known, follows = curve(run, known)
        steps.append((known.images, follows))
    assert steps == [((40,), True), ((40, 52), True), ((40, 52, 60), False), ((40, 52, 60), False)]


def test_nothing_is_computed_before_it_is_old_and_the_process_has_rested(run: Path) -> None:
    seconds = [0.0]
    learning = Learning(lambda: seconds[0])
    known = Curve((40,), (0.5,))
    what = _subject(run, curve)
    learning._known[what], learning._computed[what], learning._rested = known, 100, 9.0
    for shots, growing, at, begins in (
        (129, True, 9.0, False),
        (100, False, 9.0, False),
        (130, True, 8.9, False),
        (130, True, 9.0, True),
    ):
        seconds[0] = at
        assert learning.curve(run, shots, growing=growing) == known
        assert (learning._pending is not None) is begins
    learning.close()


def test_whoever_had_the_last_steps_lets_the_others_ask_first(run: Path) -> None:
    learning = Learning(lambda: 0.0)

    def begun(ask: Callable[..., object], images: int) -> bool:
        ask(run, images, growing=False)
        if learning._pending is None:
            return False
        learning._pending[2].result(60)
        return True

    try:
        turns = [learning.curve, learning.curve, learning.following, learning.curve, learning.curve, learning.curve]
        asked = [begun(ask, 60 + place) for place, ask in enumerate(turns)]
        assert asked == [True, False, True, True, False, True], "nobody else asks the second time"
    finally:
        learning.close()


def test_runs_are_found_by_their_names_only(run: Path) -> None:
    watching = Watching(run.parent)
    assert watching.run("run") is watching.run("run")
    for name in ("..", "run/shards", str(run), "", "run\x00"):
        assert watching.run(name) is None
    watched = watching.run("run")
    assert watched is not None
    watched.look()
    assert watched.records == (66, 66)
    assert [latest.kind for latest in watched.latest] == ["reference"]
    assert watching.running() == []
    watching.learning.close()


def test_the_command_that_is_started_is_one_that_labctl_takes(tmp_path: Path) -> None:
    settings = {"images": "4", "window": "1 ns"}
    asked = Asked("image-readout", settings, station="no such.toml", armed=True, attended=True)
    words = [*asked.words, f"--out={tmp_path / 'run'}"]
    assert words == [
        "run",
        "image-readout",
        "--set=images=4",
        "--set=window=1 ns",
        "--station=no such.toml",
        "--arm",
        "--attended",
        f"--out={tmp_path / 'run'}",
    ]
    assert Asked("image-readout", over=("window=1 ns,2 ns",)).words == [
        "sweep",
        "image-readout",
        "--over=window=1 ns,2 ns",
    ]
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    with pytest.raises(ValueError, match="no such protocol"):
        _ = Asked("--help").words


def test_a_run_is_resumed_whatever_it_is_called(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copytree(run, tmp_path / "-x")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(to_resume(Path() / "-x", "", armed=True, attended=True))
    assert (ended.value.code, capsys.readouterr().out) == (0, "-x: complete already\n")


@pytest.mark.full
def test_what_the_command_refuses_is_told() -> None:
    started = launcher.start(Asked("image-readout", {"images": "many"}).words, {})
    started.process.wait(60)
    assert "images = 'many'" in started.failure()
    started.printed.close()


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks into /proc")
def test_a_command_that_has_ended_is_no_process_any_more_though_nobody_asks() -> None:
    started = launcher.start(["--version"], {})
    entry = Path(f"/proc/{started.process.pid}")
    started.printed.close()
    del started
    until(lambda: not entry.exists())


def test_a_dashboard_without_its_extra_names_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("labctl.commands.dashboard.find_spec", lambda _name: None)
    with pytest.raises(SystemExit) as ended:
        main(["dashboard", "--no-open"])
    assert ended.value.code == 2
    assert 'pip install "photonic-labctl[dashboard]"' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "refused"),
    [(["--host", ""], "--host: is empty: name an address of this machine"), (["a-file"], "a-file: is no folder: name")],
)
def test_what_cannot_be_served_is_refused(
    words: list[str],
    refused: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-file").touch()
    with pytest.raises(SystemExit) as ended:
        main(["dashboard", "--no-open", "--port", "0", *words])
    assert ended.value.code == 2
    assert f"labctl: {refused}" in capsys.readouterr().err
