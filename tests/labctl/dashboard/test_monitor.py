"""What is shown of a run while it measures: one shot at a time, on scales that stay."""

import re
from itertools import count
from pathlib import Path
from shutil import rmtree

import numpy as np

from labctl.bench.station import Station
from labctl.dashboard.learning import Learning
from labctl.dashboard.listing import Wanted
from labctl.dashboard.monitor import WatchedRun, Watching
from labctl.dashboard.wording import progress, traces
from labctl.engine.inputs import images_for
from labctl.engine.session import Acquisition, acquire
from labctl.engine.thumbnail import shown_images
from labctl.runs.format.layout import RunPaths
from labctl.runs.read.run import open_run
from protocols.base import Shot, ShotKind
from protocols.image_readout import ImageReadout
from tests.observers import Follower
from tests.system.waiting import until


def test_trace_and_picture_are_of_one_shot_and_the_scale_stays(tmp_path: Path) -> None:
    directory, protocol = tmp_path / "run", ImageReadout(images=60, window=0.8e-9)
    ticks = count()
    watched = WatchedRun(directory, Learning(), lambda: float(next(ticks)))
    seen = []

    def look(_done: int, _total: int) -> None:
        watched.look()
        if watched.latest and watched.shown.has_shot:
            seen.append((watched.shown, watched.latest))

    acquire(Acquisition(protocol, Station(), directory), observer=Follower(progress=look))
    look(0, 0)
    shown = shown_images(images_for(protocol))
    with open_run(directory) as run:
        for state, latest in seen:
            assert {one.shot for one in latest} == {state.shot}
            picture = shown(Shot(0, ShotKind.IMAGE, state.dataset_index or 0, 0, 0))["image"]
            assert state.image is not None
            assert state.image.bits == picture["bits"]
            for one in latest:
                columns = [run.ports.index(port) for port in one.ports]
                assert np.array_equal(one.volts, run.volts(state.shot)[columns])
    assert seen[-1][0].shot == 64, "the last one with light, before a dark frame"
    assert [one.ports for one in seen[-1][1]] == [(2, 3, 4, 5), (6,)]
    first = [(str(one.ports), one.ends.tolist()) for _, latest in seen for one in latest]
    assert len({str(pair) for pair in first}) == 2, "a range for each pass, from its first shot to its last"
    assert "no shot" not in traces(watched.latest)


def test_a_run_in_the_place_of_another_is_another_run(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    for name, images in (("one", 45), ("other", 60)):
        acquire(Acquisition(ImageReadout(images=images, window=0.8e-9, ports=(2,)), Station(), folder / name))
    watching = Watching(folder)

    def shown() -> tuple[str, int, int]:
        watched = watching.run("one")
        assert watched is not None
        watched.look()
        curve = until(lambda: found if (found := watched.curve()).images else None)
        return watched.state.log[-1].text, watched.records[1], curve.seen

    try:
        assert shown() == ("finished: 51 shots", 51, 45)
        rmtree(folder / "one")
        (folder / "other").rename(folder / "one")
        assert shown() == ("finished: 66 shots", 66, 60)
    finally:
        watching.learning.close()


def test_a_run_whose_journal_was_cut_lacks_on_its_page_what_it_lacks_in_the_list(tmp_path: Path) -> None:
    paths = RunPaths(tmp_path / "runs" / "one")
    acquire(Acquisition(ImageReadout(images=4, window=0.8e-9, ports=(2,)), Station(), paths.directory))
    watching = Watching(paths.directory.parent)

    def said() -> str:
        watched = WatchedRun(paths.directory, watching.learning, lambda: 0.0)
        watched.look()
        return progress(watched.state, watched.records)

    assert re.search(r"finished</strong><span>6 of 6 records", said())
    paths.journal.write_bytes(b"")
    (found,) = watching.listing.runs(Wanted()).found
    assert (found.row.shots, found.row.state) == (0, "incomplete")
    assert re.search(r"incomplete</strong><span>0 of 6 records", said())
