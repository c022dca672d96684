"""The experiment b2 by the command, with few images: from the sockets to figure and report."""

from labctl.studies.paper.experiments import experiments
from tests.system.test_every_experiment import Reproduce, read, require_data
from tests.system.test_every_experiment import reproduce as reproduce  # a fixture


def test_readouts_follow_a_fibre_that_drifts(reproduce: Reproduce) -> None:
    require_data(experiments(["b2"])[0])
    content = read("b2")
    for run in content["runs"].values():
        run["settings"]["images"] = 300
        run["parameters"]["fibre_drift_time_s"] = 2e-3
    content["settings"] |= {"first": 100, "last": 150, "block": 50}
    _, entry, out = reproduce("b2", content)
    still, drifting = (entry["here"][drift]["0.4"] for drift in ("1", "0.9"))
    assert still["softmax"]["mean"] > 0.6, "guessing reaches 0.25"
    assert drifting["softmax"]["mean"] < still["softmax"]["mean"] - 0.15
    assert drifting["rls"]["mean"] > drifting["softmax"]["mean"]
    assert (out / "figures" / "b2-following.svg").is_file()
