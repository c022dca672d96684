"""The experiments b5 and b6 by the command, with few images: from the sockets to figures and report."""

from labctl.studies.paper.experiments import experiments
from tests.system.test_every_experiment import Content, Reproduce, read, require_data
from tests.system.test_every_experiment import reproduce as reproduce  # a fixture

LEAST, MOST = "five_ports_one_wavelength", "thirteen_ports_five_wavelengths"


def with_images(name: str, count: int) -> Content:
    content = read(name)
    for run in content["runs"].values():
        run["settings"]["images"] = count
    return content


def test_more_ports_and_wavelengths_are_compared_with_raw_pixels(reproduce: Reproduce) -> None:
    content = with_images("b5", 100)
    content["runs"]["ports"]["settings"]["wavelengths"] = "1550 nm, 1551 nm"
    status, entry, out = reproduce("b5", content)
    assert (status, entry["series"], entry["open"]) == (0, "beyond", 1), "one bench decides nothing"
    found = entry["here"]
    assert found[MOST]["0.4"]["mean"] > 0.5, "guessing reaches 0.25"
    assert found.keys() > {LEAST, MOST, "less_raw_pixels"}
    assert found["shortest_ns"].keys() == found["surely_ns"].keys() == found["less_raw_pixels"].keys()
    assert {path.name for path in (out / "figures").glob("b5-*.svg")} == {"b5-accuracy.svg", "b5-less-raw-pixels.svg"}


def test_whole_sets_are_judged_by_their_own_split(reproduce: Reproduce) -> None:
    require_data(experiments(["b6"])[0])
    content = with_images("b6", 400)
    content["settings"]["landmarks"] = 100
    content["must"] = content["must"][:4]  # in one line of the file that this test writes, whose length is bounded
    _, entry, out = reproduce("b6", content)
    for key in ("digits", "fashion"):
        found = entry["here"][key]
        assert found["trained"] + found["tested"] == 400
        for readout in ("linear", "kernel"):
            longest = found[readout]["4.0"]
            assert longest["low"] < longest["mean"] < longest["high"]
            assert longest["low"] > 0.1, "above chance by more than the test images scatter"
            assert entry["baseline"][key][readout]["low"] > 0.1
    assert {path.stem for path in (out / "figures").glob("b6-*.svg")} == {
        f"b6-{figure}-{key}" for figure in ("accuracy", "confusion") for key in ("digits", "fashion")
    }
