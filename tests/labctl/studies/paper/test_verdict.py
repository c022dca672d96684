"""What a figure's two columns say together, and what an experiment's figures say of it."""

import pytest

from labctl.analysis.intervals import Bound, Statistic, Verdict, counted, pooled
from labctl.studies.paper.analyses import Conclusion
from labctl.studies.paper.experiments import Baseline, Experiment, Requirement, experiments
from labctl.studies.paper.report import as_json, results
from labctl.studies.paper.reproduction import Column, Reproduced
from labctl.studies.paper.verdict import Comparison, Judged, cause, comparisons, passed, verdicts

HIGH, MIDDLE, LOW = (pooled([mean - 0.01, mean, mean + 0.01]) for mean in (0.97, 0.94, 0.90))
ONE = pooled([0.5])
MUST = Requirement(what="accuracy", path=("accuracy",), at_least=0.90, averaged_at_least=0.94, percent=True)


def reproduced(single: Statistic, averaged: Statistic | None, *musts: Requirement) -> Reproduced:
    found = [single] if averaged is None else [single, averaged]
    experiment = Experiment.model_validate(
        {
            "name": "mine",
            "title": "",
            "paper": "",
            "statement": "",
            "analysis": "traces",
            "averages": [1, 16][: len(found)],
            "runs": {"chip": {"protocol": "image-readout"}},
            "must": musts or (MUST,),
            "cause": "little light",
        }
    )
    columns = tuple(
        Column((), Conclusion({"accuracy": figure}, {"network": pooled([[0.8, 0.9]] * 3)}), {}) for figure in found
    )
    return Reproduced(experiment, (1, 2, 3), 10, columns, 0.0)


@pytest.mark.parametrize(
    ("single", "averaged", "expected", "passes"),
    [
        (HIGH, HIGH, [Verdict.REACHED, Verdict.REACHED], True),
        (LOW, HIGH, [Verdict.OPEN, Verdict.REACHED], True),
        (LOW, MIDDLE, [Verdict.OPEN, Verdict.OPEN], True),
        (ONE, ONE, [Verdict.OPEN, Verdict.OPEN], True),
        (HIGH, LOW, [Verdict.REACHED, Verdict.NOT_REACHED], False),
        (pooled([0.5, 0.51]), HIGH, [Verdict.NOT_REACHED, Verdict.REACHED], False),
    ],
)
def test_an_experiment_fails_only_where_a_figure_is_surely_short(
    single: Statistic, averaged: Statistic, expected: list[Verdict], passes: bool
) -> None:
    found = reproduced(single, averaged)
    assert verdicts(found) == expected
    assert passed(found) is passes
    assert cause(found) == ("" if passes else "little light")


@pytest.mark.parametrize(
    ("single", "averaged", "only"),
    [
        (LOW, HIGH, True),
        (HIGH, HIGH, False),
        (MIDDLE, HIGH, False),
        (LOW, MIDDLE, False),
        (ONE, ONE, False),
    ],
)
def test_what_averages_alone_reach_is_what_the_columns_say(single: Statistic, averaged: Statistic, only: bool) -> None:
    (found,) = comparisons(reproduced(single, averaged))
    assert found.averages_only is only is (verdicts(reproduced(single, averaged)) == [Verdict.OPEN, Verdict.REACHED])
    assert as_json(reproduced(single, averaged))["must"][0]["averages_only"] is only


@pytest.mark.parametrize(("single", "only"), [(LOW, True), (HIGH, False)])
def test_single_triggers_without_a_bound_are_told_from_that_of_averages(single: Statistic, only: bool) -> None:
    must = Requirement(what="accuracy", path=("accuracy",), averaged_at_least=0.94)
    (found,) = comparisons(reproduced(single, HIGH, must))
    assert found.averages_only is only


def test_a_figure_without_a_bound_is_printed_and_not_judged() -> None:
    found = reproduced(LOW, None, Requirement(what="beside", path=("accuracy",)))
    assert (verdicts(found), passed(found)) == ([], True)
    (result,) = results(found)
    assert (result.required, result.verdict, result.averaged) == ("", None, None)


def test_a_figure_that_is_not_there_fails_by_itself() -> None:
    wrong = Requirement(what="more", path=("nothing",), at_least=0.0)
    found = reproduced(HIGH, HIGH, MUST, wrong)
    right, missing = comparisons(found)
    assert (right.fell_short, missing.fell_short) == (False, True)
    assert cause(found).startswith("more: the analysis gives no figure nothing")
    assert as_json(found)["must"][1]["here"] is None


def test_a_line_says_how_sure_it_is_and_on_what() -> None:
    must = Requirement(
        what="accuracy",
        path=("accuracy",),
        at_least=0.9,
        percent=True,
        beside=Baseline(what="network", path=("network",)),
    )
    found = reproduced(pooled([[0.9] * 10, [0.92] * 10]), None, must)
    (result,) = results(found)
    assert result.here == "91.0 % [78.3, 103.7]"
    assert (result.required, result.verdict) == (">= 90.0 %", Verdict.OPEN)
    assert result.repeats == "2 × 10"  # noqa: RUF001
    assert result.baseline == "network 85.0 % (2 splits)"


def test_a_line_of_counts_says_how_many_of_how_many() -> None:
    must = Requirement(what="scenes", path=("accuracy",), at_least=1.0, percent=True)
    (result,) = results(reproduced(counted([(3, 3), (2, 2)]), None, must))
    assert (result.here, result.verdict) == ("5 of 5: 100.0 % [56.6, 100.0]", Verdict.OPEN)
    (alone,) = results(reproduced(counted([(2, 3)]), None, must))
    assert alone.here == "2 of 3: 66.7 %"


def test_a_difference_of_shares_is_in_points() -> None:
    must = Requirement(what="gain", path=("accuracy",), minus=("accuracy",), at_least=0.08, percent=True)
    (result,) = results(reproduced(HIGH, None, must))
    assert (result.here, result.required) == ("0.0 points [0.0, 0.0]", ">= 8.0 points")
    (experiment,) = experiments(["b4"])
    loss = experiment.must[0].model_copy(
        update={"path": ("accuracy",), "beside": Baseline(what="network", path=("network",))}
    )
    (result,) = results(reproduced(pooled([0.001, 0.001]), None, loss))
    assert (result.here, result.required) == ("0.1 points [0.1, 0.1]", "<= 1.0 points")
    assert result.baseline == "network 85.0 % (2 splits)"


def test_what_is_not_there_does_not_reach_its_bound() -> None:
    assert Judged(None, Bound(">=", 1.0)).verdict is Verdict.NOT_REACHED
    assert Comparison(MUST, (Judged(None, None),), wrong="nothing").fell_short, "not judged, but asked for"
