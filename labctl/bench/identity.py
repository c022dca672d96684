"""Is an instrument one that its driver is for? Found out before anything is set; what gives light goes dark then."""

from functools import partial

from instruments.bench import Bench
from instruments.errors import InstrumentError
from instruments.interfaces import Instrument
from instruments.safe_state import LIGHT, ending_with
from instruments.sections import SIMULATED
from instruments.values import Identity
from instruments.visa import NoAnswer
from labctl.bench.discovery import answers_at
from labctl.bench.station import Station


def identified(station: Station, name: str, instrument: Instrument) -> Identity:
    """Who `instrument` is.

    Raises:
        InstrumentError: it does not answer, or is another instrument than its driver is for.
    """
    identity = asked(instrument)
    require_known(station, name, identity)
    return identity


def who_they_are(station: Station, bench: Bench) -> dict[str, Identity]:
    """Who the instruments of `bench` are, by name; its observer hears of each.

    What gives light or lets it through is asked first, all of it, and what has said who it is goes dark before any
    other instrument is asked: somebody may have left it on.

    Raises:
        InstrumentError: one does not answer or obey, or is another instrument than its driver is for; others are notes.
        BenchInUse: another process has one.
    """
    found: dict[str, Identity] = {}

    def ask(name: str) -> None:
        found[name] = identified(station, name, bench.instruments[name])
        bench.observer.identified(name, found[name])

    failures: list[InstrumentError] = []
    for name in LIGHT:
        try:
            if name in bench.instruments:
                ask(name)
        except InstrumentError as error:
            failures.append(error)
    with ending_with(partial(bench.darken, found)):
        if failures:
            first, *others = failures
            for other in others:
                first.add_note(str(other))
            raise first
    for name in bench.instruments:
        if name not in LIGHT:
            ask(name)
    return found


def asked(instrument: Instrument) -> Identity:
    """Who is at the address of `instrument`: one that its driver is not for may not hear where its messages end.

    That is where it was spoken to: under a replay, not the address that the station has.

    Raises:
        LinkError: nobody answers.
    """
    try:
        return instrument.identify()
    except NoAnswer as error:
        for answer in answers_at([error.resource]):
            return answer.identity
        raise


def require_known(station: Station, name: str, identity: Identity) -> None:
    """Maker and model must read like the driver says, or contain the `identity` of the section of the station.

    One that is simulated in this process stands for any.

    Raises:
        InstrumentError: they do not.
    """
    found, section, driver = (
        f"{identity.manufacturer} {identity.model}",
        station.section_of(name),
        station.driver_of(name),
    )
    expected = section.identity
    if expected is not None:
        known = expected.casefold() in found.casefold()
    else:
        known = section.address == SIMULATED or driver.identity is None or driver.identity.search(found) is not None
    if not known:
        wanted = f"{name}.identity = {expected!r}" if expected is not None else f"driver {section.driver!r}"
        raise InstrumentError(
            f"{name} at {section.address}: is {found!r}, which {wanted} is not for: correct {name}.address in "
            f"{station.source}, or write {name}.identity = {found!r} if it is the right one"
        )
