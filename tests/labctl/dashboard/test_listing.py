"""What the list of runs asks for, and how seldom it looks."""

import shutil
from pathlib import Path

import pytest

from labctl.bench.station import Station
from labctl.dashboard.listing import Listing, Wanted
from labctl.engine.session import Acquisition, acquire
from labctl.runs.catalogue import Catalogue
from labctl.runs.read.follower import Follower
from protocols.image_readout import ImageReadout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("lab") / "runs"
    acquire(Acquisition(ImageReadout(images=4, window=0.8e-9, ports=(2,)), Station(), found / "first"))
    return found


def test_a_list_is_wanted_by_the_address_of_its_page() -> None:
    wanted = Wanted.of({"where": "tag = good", "columns": "Images, accuracy,", "sort": ""})
    assert wanted == Wanted("tag = good", ("images", "accuracy"))
    assert wanted.address == "where=tag+%3D+good&columns=images%2Caccuracy"
    assert Wanted().address == ""


def test_what_was_found_is_kept_for_a_while_and_is_looked_for_when_told(folder: Path) -> None:
    now = [0.0]
    listing = Listing(folder, lambda: now[0])
    assert [one.row.name for one in listing.runs(Wanted()).found] == ["first"]
    shutil.copytree(folder / "first", folder / "second")
    assert listing.runs(Wanted()).total == 1
    listing.look_again()
    assert listing.runs(Wanted(most=1)).total == 2
    assert len(listing.runs(Wanted(most=1)).found) == 1
    assert listing.runs(Wanted(sort="nothing")).found == listing.runs(Wanted()).found
    assert listing.runs(Wanted("imagse > 3")).refused
    assert listing.names("alarm = 1") == []
    assert listing.has("second")
    assert not listing.has("..")


def test_a_run_that_has_just_come_has_its_page_at_once(folder: Path) -> None:
    catalogue = Catalogue(folder, rests=1e9)
    assert not catalogue.has("late")
    shutil.copytree(folder / "first", folder / "late")
    assert catalogue.has("late")
    for name in ("nothing", "..", "first/shards", "\0", str(folder / "first")):
        assert not catalogue.has(name)


def test_a_picture_is_found_in_a_run_by_its_place_in_the_data_set(folder: Path) -> None:
    follower = Follower(folder / "first")
    while follower.look():
        pass
    assert len(follower.pictures) == 4
    for _, shot in follower.pictures.values():
        (seen,) = follower.shot(shot)
        assert (seen.shot, seen.kind, seen.ports) == (shot, "image", (2,))
