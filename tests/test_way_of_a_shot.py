"""The way of one shot is short enough to be read in an hour, and the page that describes it can be built."""

from benchmarks.way_of_a_shot import CLIENT, SIMULATOR, trace


def test_it_passes_few_files() -> None:
    way = trace()
    assert len(way.files(CLIENT)) <= 12
    assert len(way.files(SIMULATOR)) <= 17
    assert way.moves(CLIENT) <= 90
