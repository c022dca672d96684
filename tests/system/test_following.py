"""The experiment b2 by the command, with few images: from the sockets to figure and report."""

from labctl.studies.paper.experiments import experiments
from tests.system.test_every_experiment import Reproduce, read, require_data
from tests.system.test_every_experiment import reproduce as reproduce  # a fixture

STILL, DRIFTING = "1", "0.9"


def test_readouts_follow_a_fibre_that_drifts(reproduce: Reproduce) -> None:
    require_data(experiments(["b2"])[0])
    content = read("b2")
    settings = content["settings"] | {"first": 100, "last": 150, "block": 50}
    settings["drifts"] = [drift for drift in settings["drifts"] if drift["key"] in (STILL, DRIFTING)]
    content["settings"] = settings
    content["must"] = [must for must in content["must"] if must["path"][0] in (STILL, DRIFTING)]
    content["runs"] = {drift["run"]: content["runs"][drift["run"]] for drift in settings["drifts"]}
    for run in content["runs"].values():
        run["settings"] |= {"images": 300, "reference_every": 5}
        run["parameters"]["fibre_drift_time_s"] = 5.5e-3  # 90 of these images
    _, entry, out = reproduce("b2", content)
    still, drifting = (entry["here"][drift]["0.4"] for drift in (STILL, DRIFTING))
    assert still["softmax"]["mean"] > 0.6, "guessing reaches 0.25"
    assert drifting["softmax"]["mean"] < still["softmax"]["mean"] - 0.05
    assert drifting["rls"]["mean"] > drifting["softmax"]["mean"]
    assert (out / "figures" / "b2-following.svg").is_file()
