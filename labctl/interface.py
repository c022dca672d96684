"""What `import labctl` offers beside `open_run` and `open_runs`: bench, runs and readouts, as commands have them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from instruments.bench import Observer
from instruments.units import value_in
from labctl.bench.opening import Access
from labctl.bench.signals import interruptible
from labctl.bench.station import Station, read_station
from labctl.engine.engine import Outcome
from labctl.engine.hands import Hands, Traces, in_hands
from labctl.engine.plan import new_directory
from labctl.engine.session import Acquisition, acquire
from labctl.reports.live_trace import LiveTrace
from labctl.runs.catalogue import Catalogue, Found
from labctl.runs.format.store import here, location
from labctl.studies.readout_evaluation import evaluate_readout
from labctl.studies.readout_training import train_readout
from labctl.studies.sweeps.declaration import declared, points, refuse_set_twice
from labctl.studies.sweeps.evaluation import evaluate_sweep
from labctl.studies.sweeps.folder import Measured, begin, carry_out, forecasts
from labctl.studies.sweeps.folder import new_directory as new_sweep_directory
from labctl.studies.sweeps.run_folder import own_runs
from protocols.registry import named_protocol, with_settings

ORIGIN = "settings"


@contextmanager
def bench(
    station: Path | str | None = None,
    *,
    wavelength: float | str = 1550.0,
    drive_seed: int = 1,
    armed: bool = False,
    attended: bool = False,
) -> Iterator[Hands]:
    """A bench to use by hand: show images, take traces, set the laser. It is dark at the end, however that comes.

    Args:
        station: Station file; None for the simulated bench.
        wavelength: Of the first light, nm or text.
        drive_seed: Of the pseudorandom drive, as the setting of the protocols.
        armed: Light is allowed, as `--arm`.
        attended: Somebody stands at the laser's key switch, as `--attended`.

    Raises:
        ValueError: the text is no wavelength.
        LabctlError: the station is wrong, the bench in use, or an instrument failed; one line.

    Example:
        >>> import labctl, numpy
        >>> with labctl.bench() as bench:
        ...     bench.show(numpy.eye(28))
        ...     bench.laser.power = "10 mW"
        ...     bench.capture(window="1 ns", ports=[2, 3]).volts.shape
        (2, 25)
    """
    wavelength_nm = value_in(wavelength, "nm")
    access = Access(attended, armed)
    with in_hands(_station(station), access, wavelength_nm=wavelength_nm, drive_seed=drive_seed) as hands:
        yield hands


def live_trace(traces: Iterable[Traces]) -> Traces:
    """Show traces in a notebook as they come, each in the place of the one before; returns the last.

    Those of a simulated bench are marked, as in every figure.

    Interrupt the kernel to end it: within `with labctl.bench()` the bench goes dark.

    Args:
        traces: Such as `(bench.capture() for _ in range(50))`.

    Raises:
        LabctlError: there is no notebook, or an instrument failed.
        ValueError: there is not one trace.
    """
    view, last = LiveTrace(), None
    for last in traces:
        view.show(last.time_s, last.volts, last.ports, last.origin)
    if last is None:
        raise ValueError("no trace to show: give some, such as (bench.capture() for _ in range(50))")
    return last


def run(
    protocol: str = "image-readout",
    *,
    station: Path | str | None = None,
    out: Path | str | None = None,
    data: Path | str | None = None,
    armed: bool = False,
    attended: bool = False,
    observer: Observer | None = None,
    **settings: Any,
) -> Outcome:
    """Carry out a protocol and store the run: `labctl run`. Ctrl-C once finishes the shot.

    Args:
        protocol: Name of a protocol, or a Python file that defines one.
        station: Station file; None for the simulated bench.
        out: Run directory, new or empty; None for a new one under `runs/`.
        data: Folder of data sets that is looked at first.
        armed: Light is allowed, as `--arm`.
        attended: Somebody stands at the laser's key switch.
        observer: Follows the run.
        settings: Of the protocol, as text with units or as numbers in SI units: `images=400, window="1 ns"`.

    Raises:
        LabctlError: what was asked for is wrong, before there is light; or an instrument failed, and finished shots
            are kept.
    """
    asked = with_settings(named_protocol(protocol), settings, origin=ORIGIN)
    directory = new_directory(asked, datetime.now(UTC)) if out is None else Path(out)
    found = _station(station, projector=asked.projector)
    acquisition = Acquisition(asked, found, directory, _path(data), Access(attended, armed))
    with interruptible() as interruption:
        return acquire(acquisition, observer=observer, interruption=interruption).outcome


def sweep(
    protocol: str,
    over: Mapping[str, str | Sequence[str | float]],
    *,
    zip: bool = False,  # noqa: A002 -- as the command's option
    order: str = "random",
    reference_every: int = 10,
    station: Path | str | None = None,
    out: Path | str | None = None,
    data: Path | str | None = None,
    armed: bool = False,
    attended: bool = False,
    **settings: Any,
) -> Measured:
    """Carry out a protocol at every point of one or several axes: `labctl sweep`.

    Args:
        protocol: Name of a protocol, or a Python file that defines one.
        over: Values of each axis: texts, numbers where there is no unit, or one text with a list or a range,
            `{"power": "10:30:5 mW"}`.
        zip: Axes side by side instead of every combination.
        order: "random", "interleaved" or "as-given".
        reference_every: The first point is measured first, last and after so many others; 0: once.
        station: Station file; None for the simulated bench.
        out: Folder of the sweep, new or empty; None for a new one under `runs/`.
        data: Folder of data sets that is looked at first.
        armed: Light is allowed, as `--arm`.
        attended: Somebody stands at the laser's key switch.
        settings: Of the protocol at every point.

    Raises:
        LabctlError: what was asked for is wrong, before there is light; or an instrument failed, and what was measured
            is kept: `labctl resume`.
    """
    measured = named_protocol(protocol)
    told = {"settings": settings, "over": over, "zip": zip, "order": order, "reference_every": reference_every}
    asked = declared({"protocol": measured.name, **told}, "sweep")
    refuse_set_twice(asked)
    found = _station(station, projector=measured.projector)
    every = points(asked, measured, found)
    directory = new_sweep_directory(every[0].protocol, datetime.now(UTC)) if out is None else Path(out)
    access = Access(attended, armed)
    for _ in forecasts(every, data=_path(data), access=access):
        pass  # what cannot be is refused before anything is made
    kept = every[0].protocol.model_dump(mode="json", include=set(settings))
    begin(directory, asked.model_copy(update={"settings": kept}), measured, found)
    with interruptible() as interruption:
        return carry_out(
            directory,
            every,
            data=_path(data),
            access=access,
            interruption=interruption,
            follow=lambda _number, _count, _point: nullcontext(Observer()),
        )


def runs(
    where: str = "", *, folder: Path | str = "runs", sort: str = "started", limit: int | None = None
) -> list[Found]:
    """The runs of a folder that fit a search, the newest last: `labctl runs --where`.

    Args:
        where: Such as `"images >= 300 and tag = good"`; all if empty.
        folder: Folder of the runs, or of a sweep: a path, or a URL such as `s3://bucket/lab`.
        sort: Any key.
        limit: Only the last so many.

    Raises:
        UsageError: the words are not understood, no run has that key, or `limit` is below 1.
        RunError: it is the folder of a sweep that is damaged, or was not begun here and has its runs in a store.
    """
    place, only = own_runs(location(folder))
    return Catalogue(place, only=only).find(where, sort=sort, limit=limit)


def train(
    run: Path | str,
    *,
    window: float | str = 0.4e-9,
    ports: Sequence[int] | None = None,
    seed: int = 1,
    out: Path | str | None = None,
) -> dict[str, Any]:
    """Train a softmax readout on nine tenths of the images of a run and save it: `labctl train`.

    Args:
        run: Run directory.
        window: Acquisition time T_N, s or text.
        ports: Ports that the readout uses; None for all.
        seed: Which images are kept apart.
        out: File to write; None for one in the run's folder `models`.

    Returns:
        What the command prints as JSON: `model`, `accuracy`, `interval`, ...

    Raises:
        ValueError: the text of `window` is no time.
        LabctlError: no such run, window or port, or too few images.
    """
    chosen = None if ports is None else tuple(ports)
    return train_readout(here(run), window_s=value_in(window, "s"), ports=chosen, seed=seed, out=_path(out))


def evaluate(subject: Path | str, run: Path | str | None = None) -> dict[str, Any]:
    """Test a readout on a run, or judge a sweep: `labctl evaluate`.

    Args:
        subject: Model file, or the folder of a sweep.
        run: Run directory to test the model on, or its URL.

    Returns:
        What the command prints as JSON.

    Raises:
        LabctlError: not a readout, or a run it does not fit; or no such sweep.
    """
    return evaluate_sweep(here(subject)) if run is None else evaluate_readout(location(subject), location(run))


def _station(path: Path | str | None, *, projector: bool | None = None) -> Station:
    found = read_station(_path(path))
    return found if path is not None or projector is None else found.cabled(projector=projector)


def _path(path: Path | str | None) -> Path | None:
    return None if path is None else Path(path)
