"""Every experiment of the house by the command, so small that it takes seconds, from the sockets to table and report.

What is made smaller are numbers of images, of symbols and of what learns, and the averages and length of long records;
wavelengths, ports, windows and everything else stay as the experiment's file says. The figures are then not those of
the paper, but they are there, and they show that something was seen.
"""

import json
import math
import os
import re
import tomllib
from collections.abc import Callable, Mapping
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import pytest

from labctl import datasets
from labctl.commands.main import main
from labctl.runs.read.run import open_run
from labctl.studies.paper.experiments import FOLDER, Experiment, experiments
from protocols.registry import protocol_from
from tests.data_sets import require

pytestmark = pytest.mark.timeout(1200)  # the first test waits for all experiments, whatever else the machine does

Content = dict[str, Any]
Entry = dict[str, Any]

MOST_IMAGES = 100
"""Of a run in all, or of each class where an experiment gives a number for each."""
WHERE_SET: Content = {"symbols": 700, "train": 70, "learning_sizes": [50, 90]}
"""In place of what an experiment's file sets by these names, for runs or analysis."""
BY_PROTOCOL: dict[str, Content] = {
    "dynamic-scene": {"window": "7 us"},
}
"""In every run of these protocols; nothing is to be seen in a scene long after the mirrors have moved."""
AVERAGES = [1, 4]
"""Of what learns."""
BY_ANALYSIS: dict[str, Content] = {"forecasting": {"train": 500, "test": 200, "held_out": 120}}
"""In place of what an analysis does unless its experiment says otherwise."""


def smaller(content: Content) -> Content:
    """An experiment's file with smaller numbers in it."""
    if content["analysis"] != "traces":
        content["averages"] = AVERAGES
    tables = [content.setdefault("settings", {})]
    for run in content["runs"].values():
        settings = run.setdefault("settings", {})
        settings |= BY_PROTOCOL.get(run["protocol"], {})
        given = protocol_from(run["protocol"], settings, origin="the file").model_dump()
        if isinstance(given.get("images"), tuple):
            settings["images"] = [min(count, MOST_IMAGES) for count in given["images"]]
        elif "images" in given:
            settings["images"] = min(given["images"], MOST_IMAGES)
        tables.append(settings)
    for table in tables:
        table |= {name: small for name, small in WHERE_SET.items() if name in table}
    content["settings"] |= BY_ANALYSIS.get(content["analysis"], {})
    return content


def toml(value: Any) -> str:
    """A value as TOML, tables inline: strings, numbers and truth values are written as in JSON."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(name)} = {toml(one)}" for name, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def write(folder: Path, name: str, content: Content) -> None:
    folder.mkdir(exist_ok=True)
    lines = [f"{json.dumps(key)} = {toml(value)}\n" for key, value in content.items()]
    (folder / f"{name}.toml").write_text("".join(lines), encoding="utf-8")


def read(name: str) -> Content:
    """An experiment's file, but for what options vary."""
    content = tomllib.loads((FOLDER / f"{name}.toml").read_text("utf-8"))
    return {key: value for key, value in content.items() if key not in ("sensitivity", "fit")}


def use(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the command find its experiments in `folder`, and work on one core: tests run side by side."""
    monkeypatch.setattr("labctl.commands.reproduce.experiments", partial(experiments, folder=folder))
    monkeypatch.setattr(os, "cpu_count", lambda: 1)


Everything = tuple[int, Entry, Path]


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Everything:
    """All experiments by one command, equal runs measured once: exit status, JSON, and where it wrote."""
    folder = tmp_path_factory.mktemp("everything")
    for experiment in experiments():
        write(folder / "experiments", experiment.name, smaller(read(experiment.name)))
    with pytest.MonkeyPatch.context() as monkeypatch:
        use(folder / "experiments", monkeypatch)
        with pytest.raises(SystemExit) as ended:
            main(["reproduce", "all", "--quick", "--json", "--out", str(folder / "out")])
    whole = json.loads((folder / "out" / "report.json").read_text("utf-8"))
    return int(ended.value.code or 0), whole, folder / "out"


def brief() -> Content:
    """Figure 3 from few images at two acquisition times, for what does not depend on the size of an experiment."""
    content = read("fig3")
    for run in content["runs"].values():
        run["settings"] |= {"images": 40}
    content["settings"] |= {"windows": ["0.4 ns", "0.56 ns"], "numerical_windows": ["0.4 ns"], "learning_sizes": [20]}
    content["averages"] = [1]
    content["must"] = [
        {"what": must["what"], "path": must["path"], "at_least": must["at_least"]}
        for must in content["must"]
        if must["path"][-1] in ("0.4", "0.56")
    ]
    return content


Reproduce = Callable[..., tuple[int, Entry, Path]]


@pytest.fixture
def reproduce(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Reproduce:
    """The command on an experiment's file written to a folder of its own: exit status, JSON, and where it wrote."""
    use(tmp_path / "experiments", monkeypatch)

    def carry_out(name: str, content: Content, *others: str, out: str = "out") -> tuple[int, Entry, Path]:
        write(tmp_path / "experiments", name, content)
        with pytest.raises(SystemExit) as ended:
            main(["reproduce", name, *others, "--quick", "--json", "--out", str(tmp_path / out)])
        return int(ended.value.code or 0), json.loads(capsys.readouterr().out), tmp_path / out

    return carry_out


def require_data(experiment: Experiment) -> None:
    """Skip where a data set that does not come with the program is not at hand."""
    for protocol in experiment.protocols.values():
        name = datasets.card(protocol.model_dump()["dataset"]).name
        require(name)


def above_chance(classes: int, tested: int) -> float:
    """A share of right answers that guessing reaches once in 30000 times: four standard errors above chance."""
    chance = 1 / classes
    return chance + 4 * math.sqrt(chance * (1 - chance) / tested)


def recognised(content: Content, entry: Entry) -> None:
    """Every accuracy that must be reached at full size lies above chance; a tenth of the images is tested a split."""
    tested = entry["splits"] * (MOST_IMAGES // 10)
    accuracies = figures(content, entry, lambda must: "minus" not in must)
    assert min(accuracies) > above_chance(len(content["settings"]["classes"]), tested)


def vowels_recognised(content: Content, entry: Entry) -> None:
    """As above, of utterances: half of the 60 are tested in a split, or those of 7 of 15 speakers."""
    tested = entry["splits"] * 60 * 7 // 15
    assert min(figures(content, entry)) > above_chance(4, tested)


def cracks_found(content: Content, entry: Entry) -> None:
    """The area under the curve is four standard errors above that of scores dealt at random (Mann and Whitney)."""
    normal, cracks = MOST_IMAGES - content["settings"]["train"], MOST_IMAGES
    error = math.sqrt((normal + cracks + 1) / (12 * normal * cracks))
    assert min(figures(content, entry, lambda must: "at_least" in must)) > 0.5 + 4 * error


def predicted(content: Content, entry: Entry) -> None:
    """Half of what is left by answering the mean, which has an error of 1, is gone."""
    assert max(figures(content, entry)) < 0.5


def images_made_again(content: Content, entry: Entry) -> None:
    """The best readout leaves less than nine tenths of the squared error of the mean image at every window.

    Readouts of noise do no better than the mean image. The network is not asked: it needs more images.
    """
    for curve in content["settings"]["curves"]:
        least = entry["baseline"][curve["key"]]["mean_image"]["mean"]
        assert all(reached["mean"] ** 2 < 0.9 * least**2 for reached in entry["here"][curve["key"]]["best"].values())


def switch_seen(_content: Content, entry: Entry) -> None:
    """The correlations with the two images cross while the mirrors move: no readout has learnt that."""
    for column in (entry["here"], entry["averaged"]):
        assert column["switch_by_correlation"]["share_within_1_us"]["mean"] == 1.0


def all_reached(content: Content, entry: Entry) -> None:
    """Nothing learns here: it is carried out as the house's file says."""
    assert content["runs"] == read(entry["name"])["runs"]
    assert entry["passed"]


def figures(content: Content, entry: Entry, chosen: Callable[[Content], bool] = lambda _must: True) -> list[float]:
    """Those of the figures that are `chosen` by their tables in the experiment's file, of single triggers and means."""
    return [
        column["here"]
        for must, found in zip(content["must"], entry["must"], strict=True)
        if chosen(must)
        for column in (found, found["averaged"])
    ]


SEEN: Mapping[str, Callable[[Content, Entry], None]] = {
    "recognition": recognised,
    "vowels": vowels_recognised,
    "cracks": cracks_found,
    "forecasting": predicted,
    "imaging": images_made_again,
    "scenes": switch_seen,
    "traces": all_reached,
}
"""By analysis: what shows that the bench saw something, at a size at which the paper's figures cannot be reached."""


@pytest.mark.parametrize("experiment", experiments(), ids=lambda experiment: experiment.name)
def test_an_experiment_goes_from_its_file_to_figures_and_report(experiment: Experiment, everything: Everything) -> None:
    require_data(experiment)
    _, whole, out = everything
    content = smaller(read(experiment.name))
    (entry,) = [entry for entry in whole["experiments"] if entry["name"] == experiment.name]

    assert entry.keys() >= {"name", "paper", "here", "baseline", "seeds", "splits", "passed", "seconds"}
    assert entry["paper"] == experiment.paper
    assert (entry["seeds"], entry["splits"]) == (experiment.quick_twins, experiment.quick_splits)
    assert len(entry["must"]) == len(experiment.must)
    for column in (column for must in entry["must"] for column in (must, must["averaged"])):
        assert math.isfinite(column["here"])
        assert (column["low"], column["seeds"]) == (None, 1)
        assert column["verdict"] == ("open" if column["required"] else None), "one bench decides nothing"
    assert (entry["passed"], entry["cause"]) == (True, "")

    drawn = list((out / "figures").glob(f"{experiment.name}-*.svg"))
    assert drawn
    for svg in drawn:
        assert svg.read_text("utf-8").endswith("</svg>\n")
        assert svg.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert escape(experiment.title) in (out / "report.html").read_text("utf-8")

    if experiment.analysis in SEEN:
        SEEN[experiment.analysis](content, entry)


def test_one_report_holds_every_figure(everything: Everything) -> None:
    status, whole, out = everything
    assert status == (0 if whole["passed"] else 1)
    assert whole["passed"] == all(entry["passed"] for entry in whole["experiments"])
    assert whole["open"] == sum(entry.get("open", 0) for entry in whole["experiments"])
    assert [entry["name"] for entry in whole["experiments"] if "skipped" not in entry] == [
        name for name in (found.name for found in experiments()) if list((out / "figures").glob(f"{name}-*.svg"))
    ]
    page = (out / "report.html").read_text("utf-8")
    assert page.count("<figure") == len(list((out / "figures").glob("*.svg")))
    assert not re.search(r"""(?:href|src)\s*=\s*["']?\s*https?:""", page), "it stands alone"


def test_the_same_seed_gives_the_same_frames_and_figures(reproduce: Reproduce, everything: Everything) -> None:
    (first,) = [entry for entry in everything[1]["experiments"] if entry["name"] == "fig2"]
    again = reproduce("fig2", smaller(read("fig2")))[1]
    assert [open_run(run).digest() for run in first["runs"]] == [open_run(run).digest() for run in again["runs"]]
    assert (first["here"], first["baseline"]) == (again["here"], again["baseline"])


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"analysis": "cracks"}, "experiment fig3: settings: "),
        ({"settings": {"classes": ["0"], "curves": [], "windows": ["1 ns"]}}, "experiment fig3: settings: curves"),
        ({"runs": {"bypass": read("fig3")["runs"]["bypass"]}}, "reads runs.chip, which the file does not have: it has"),
        ({"runs": {}}, "fig3.toml: runs = {}: "),
    ],
)
def test_a_wrong_file_is_told_before_anything_is_acquired(wrong: Content, complaint: str, reproduce: Reproduce) -> None:
    status, told, out = reproduce("fig3", smaller(read("fig3")) | wrong)
    assert status == 2
    assert complaint in told["error"]
    assert not out.exists()


def test_figures_asked_for_in_vain_cost_nothing_that_was_measured(reproduce: Reproduce) -> None:
    content = smaller(read("fig2"))
    asked: dict[str, Content] = {
        "the analysis gives no figure chip.port 9: correct `must`": {"path": ["chip", "port 9"]},
        "the analysis gives no figure bypass": {"path": ["chip"], "minus": ["bypass"]},
        "the analysis gives no figure over benches chip.least": {"path": ["chip", "least"]},
        "the analysis gives no figure pixels": {"path": ["chip"], "beside": {"what": "pixels", "path": ["pixels"]}},
    }
    content["must"] += [{"what": "one of mine", "at_least": 1.0} | must for must in asked.values()]
    status, entry, out = reproduce("fig2", content)
    assert status == 1
    assert [must["verdict"] for must in entry["must"]] == [None] * 2 + ["not reached"] * len(asked)
    assert [must["averaged"]["verdict"] for must in entry["must"]] == ["open"] * 2 + ["not reached"] * len(asked)
    assert [must["reached"] for must in entry["must"]] == [None] * 2 + [False] * len(asked)
    assert [must["here"] for must in entry["must"][2:]] == [None] * len(asked)
    assert entry["here"].keys() >= {"input", "chip"}
    page = (out / "report.html").read_text("utf-8")
    for complaint in asked:
        assert f"one of mine: {complaint}" in entry["cause"]
        assert complaint in page
    assert json.loads((out / "report.json").read_text("utf-8"))["experiments"][0]["must"] == entry["must"]


def test_an_analysis_that_fails_costs_no_other_experiment_its_results(reproduce: Reproduce, tmp_path: Path) -> None:
    too_long = brief()
    too_long["settings"] |= {"windows": ["3 ns"], "confusion": []}
    write(tmp_path / "experiments", "too-long", too_long)
    status, whole, out = reproduce("fig2", smaller(read("fig2")), "too-long")
    fig2, failed = whole["experiments"]
    assert status == 1
    assert (fig2["name"], fig2["passed"]) == ("fig2", True)
    assert failed["name"] == "too-long"
    assert "3 ns" in failed["failed"]
    assert failed["failed"] in (out / "report.html").read_text("utf-8")
    assert json.loads((out / "report.json").read_text("utf-8")) == whole
    assert reproduce("too-long", too_long, out="alone")[1].keys() == {"error", "exit"}
