"""`labctl evaluate`: what a run says, by itself or with a readout."""

from pathlib import Path
from typing import Annotated, Any

import typer

from labctl.analysis.prequential import READOUTS
from labctl.commands.exit_status import DONE
from labctl.commands.next_steps import cannot_judge, protocol_of, require_readout
from labctl.commands.output import JsonOption, say, show, table
from labctl.commands.ranges import ports_of
from labctl.commands.scheduler import SideBySideOption, carrying
from labctl.commands.train import say_what_is_special, seconds, with_interval
from labctl.errors import UsageError
from labctl.runs.format.store import here, location
from labctl.runs.sweep import is_sweep
from labctl.studies import online as online_study
from labctl.studies.fibre import in_words, measure_fibre
from labctl.studies.readout_evaluation import evaluate_readout
from labctl.studies.sweeps.evaluation import evaluate_sweep
from protocols.base import Judgement

NOT_JUDGED = ("not judged", "too few such shots in this run, or of one class alone")


def evaluate(
    subject: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL|RUN|SWEEP",
            help="Model file that labctl train wrote, a run directory, or the folder of a sweep.",
            parser=location,
        ),
    ],
    run: Annotated[
        Path | None,
        typer.Argument(metavar="RUN", help="With a model: run directory to test it on, or its URL.", parser=location),
    ] = None,
    online: Annotated[
        bool,
        typer.Option("--online", help="A run by itself: readouts that follow it shot by shot, beside frozen ones."),
    ] = False,
    window: Annotated[
        str | None,
        typer.Option(
            "--window", help='With --online: acquisition time T_N; default "0.4 ns". Of a sweep: part of its records.'
        ),
    ] = None,
    ports: Annotated[
        str | None, typer.Option("--ports", help='With --online or of a sweep: ports, such as "2-5"; without it all.')
    ] = None,
    scheduler: SideBySideOption = None,
    as_json: JsonOption = False,
) -> int:
    """Test a readout, a sweep or a scan, and print how good the result is.

    MODEL RUN: tests a readout on shots it has not seen, and its kind on random and forward-in-time splits, with
    controls. SWEEP: a readout at each of its points, with a figure. RUN --online: test, then train, in the order it was
    measured. RUN of wavelength-scan: correlation against detuning, its half width, the fibre's delay spread.
    """
    if is_sweep(subject) and not online and run is None:
        here(str(subject))  # its figure is written into it
        window_s = None if window is None else seconds(window)
        swept = evaluate_sweep(
            subject, window_s=window_s, ports=ports_of(ports), carried_out=carrying(scheduler, "evaluate")
        )
        show(swept, as_json, lambda: _print_sweep(swept))
        return DONE
    if scheduler is not None:
        raise UsageError("--scheduler is for sweeps: leave it out")
    if online:
        return _online(subject, run, window, ports, as_json)
    if window is not None or ports is not None:
        raise UsageError(
            "--window and --ports are for --online and sweeps: a model has its own, a scan is measured as a whole"
        )
    if run is not None:
        require_readout(run)
        judged = evaluate_readout(subject, run)
        show(judged, as_json, lambda: _print_readout(judged))
        return DONE
    if subject.is_file():
        raise UsageError(f"{subject}: a model file is tested on a run: name the run directory after it")
    if protocol_of(subject)[1] is not Judgement.ITSELF:
        raise cannot_judge(subject)
    found = measure_fibre(subject)
    show(found, as_json, lambda: _print(found))
    return DONE


def _online(subject: Path, model_run: Path | None, window: str | None, ports: str | None, as_json: bool) -> int:
    if model_run is not None or subject.is_file():
        raise UsageError(f"{subject}: --online trains readouts of its own: name the run directory alone")
    if not subject.is_dir():
        raise UsageError(f"{subject}: no such directory: name a run directory, as 'labctl runs' lists them")
    require_readout(subject)
    window_s = None if window is None else seconds(window)
    found = online_study.evaluate_online(subject, window_s=window_s, ports=ports_of(ports))
    show(found, as_json, lambda: _print_online(found))
    return DONE


def _print_readout(found: dict[str, Any]) -> None:
    rows = [("this readout, unseen shots", with_interval(found), f"{found['test_shots']} shots, 95 % interval")]
    if (random := found["random_splits"]) is None:
        rows.append(("random splits", *NOT_JUDGED))
    else:
        rows.append(("random splits", f"{random['mean']:.3f} ± {random['sd']:.3f}", f"{found['splits']} splits"))
    if (forward := found["forward_in_time"]) is None:
        rows.append(("forward in time", *NOT_JUDGED))
    else:
        rows.append(("forward in time", f"{forward:.3f}", "last tenth of the run"))
    if found["own_split"] is not None:
        rows.append(("the data set's own split", f"{found['own_split']:.3f}", "trained on its training part"))
    for name, control in found["controls"].items():
        if control is None:
            rows.append((f"control: {name}", *NOT_JUDGED))
            continue
        verdict = "at chance" if control["at_chance"] else "NOT at chance"
        bounds = f"{control['chance']:.3f}, marked above {control['limit']:.3f}"
        rows.append((f"control: {name}", f"{control['accuracy']:.3f}", f"{verdict}: {bounds}"))
    table(("what", "accuracy", ""), rows)
    if (other := found["other_images"]) is not None:
        known, shown = other["trained_on"], other["tested_on"]
        again = "another set called " if shown == known else ""
        say(f"this readout was trained on images of {known}; this run shows those of {again}{shown}")
    say_what_is_special(found)
    say(f"report: {found['report']}")


def _print_sweep(found: dict[str, Any]) -> None:
    table(
        ("run", *found["axes"], "accuracy", ""),
        (
            (
                row["run"][:3],
                *(row[axis] for axis in found["axes"]),
                with_interval(row),
                "" if row["complete"] else "not complete",
            )
            for row in found["points"]
        ),
    )
    if found["reference"]:
        say(f"the reference point, each time it was measured: {', '.join(f'{one:.3f}' for one in found['reference'])}")
    say(f"figure: {found['figure']}")


def _print_online(found: dict[str, Any]) -> None:
    for line in online_study.in_words(found):
        say(line)
    table(
        ("readout", f"all {found['judged_shots']} shots", f"last {found['last_shots']}"),
        (
            (READOUTS[name], *(with_interval(entry[part]) for part in ("all", "last")))
            for name, entry in found["readouts"].items()
        ),
    )
    say("in brackets: 95 % intervals of the accuracy on further images of this run")


def _print(found: dict[str, Any]) -> None:
    for line in in_words(found):
        say(line)
    say(f"report: {found['report']}")
