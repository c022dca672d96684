"""`labctl init`: a station file to begin with, from what answers and what you answer."""

import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from instruments.alnair_tlg220 import Tlg220Section
from instruments.errors import InstrumentInUse, NotConfigured
from instruments.remedies import unwritable
from instruments.sections import SIMULATED, USB, InstrumentSection, PatchPanelSection
from instruments.toml_files import describe
from instruments.units import quantity
from instruments.visa import EXAMPLE
from labctl.bench.discovery import SERIAL, Answer, answers_at, visible_addresses
from labctl.bench.draft import draft
from labctl.bench.drivers import driver, installed
from labctl.bench.lock import held_alone
from labctl.bench.schema import STATION, file_name, write_schema
from labctl.bench.station import USUAL, LimitsSection, Station, write_station
from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, show, table, tell
from labctl.commands.progress import progress_bar
from labctl.commands.questions import ask, confirm
from labctl.errors import BenchInUse, StationError, UsageError

MANUAL = "manual"
TITLES = {
    "awg": "arbitrary waveform generator",
    "scope": "oscilloscope",
    "laser": "laser",
    "dmd": "DMD",
    "patch_panel": "patch panel",
}
EVERY_PORT = "0-9,11-14"
MOST_OF_CLASS_3B_W = 0.5
"""Of a continuous laser at 1550 nm (IEC 60825-1)."""
BEFORE_QUESTIONS = f"""\
Enter takes the answer in brackets, or leaves the address empty; '{SIMULATED}' is a simulated instrument.
Write an address as VISA does, such as {EXAMPLE}."""
ABSENT = f'Not found: write its VISA address, such as "{EXAMPLE}".'


def init(
    file: Annotated[Path, typer.Argument(help="Station file to write; must be new.")] = Path("bench.toml"),
    addresses: Annotated[
        list[str] | None, typer.Option("--address", help="VISA address to ask who is there; may be repeated.")
    ] = None,
    awg: Annotated[str | None, typer.Option("--awg", help="Its VISA address.")] = None,
    scope: Annotated[str | None, typer.Option("--scope", help="Its VISA address.")] = None,
    laser: Annotated[str | None, typer.Option("--laser", help="Its VISA address, or manual.")] = None,
    dmd: Annotated[str | None, typer.Option("--dmd", help="Its VISA address, or usb.")] = None,
    patch_panel: Annotated[str | None, typer.Option("--patch-panel", help="Its VISA address, or manual.")] = None,
    name: Annotated[str | None, typer.Option("--name", help="What the bench is called.")] = None,
    laser_commands: Annotated[Path | None, typer.Option("--laser-commands", help="Command table of the laser.")] = None,
    ports: Annotated[str | None, typer.Option("--ports", help='Ports that have a fibre, such as "2-6".')] = None,
    optical_power: Annotated[
        str | None, typer.Option("--optical-power", help='What must never be exceeded, such as "30 mW".')
    ] = None,
    burst: Annotated[bool, typer.Option("--burst", help="DMD, AWG and oscilloscope are wired for bursts.")] = False,
    search: Annotated[bool, typer.Option("--search/--no-search", help="Ask every address that VISA lists.")] = True,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: options and defaults only.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Write a station file from what the instruments and you answer; no light is switched on.

    Every address is asked who is there (*IDN?), serial ports only if you name them. Without a terminal there are no
    questions.
    """
    if file.exists():
        raise StationError(f"{file}: exists: name a new file, or remove it")
    asking = sys.stdin.isatty() and not yes
    said = {"awg": awg, "scope": scope, "laser": laser, "dmd": dmd, "patch_panel": patch_panel}
    for role, place in said.items():
        _require_place(role, place or "")
    named = [*(addresses or []), *(place for place in said.values() if place and "::" in place)]
    with progress_bar("asking who is there"):
        listed = visible_addresses() if search else ()
        heard = [*named, *(place for place in listed if not place.startswith(SERIAL))]
        answers, held = _who_is_at(heard)
    proposed = {answer.instrument: answer.address for answer in reversed(answers)}
    if asking:
        for line in BEFORE_QUESTIONS.splitlines():
            tell(line)
    places: dict[str, str] = {}
    for role, title in TITLES.items():
        default = proposed.get(role, "")
        question = f"Address of the {title}" + "".join(f", or '{word}'" for word in _words(role))
        places[role] = _asked(asking, question, said[role], default, partial(_check_place, role))
        if "::" in places[role] and places[role] not in heard:
            more, held_there = _who_is_at([places[role]])
            answers, held = [*answers, *more], held | held_there
        if asking or _is_another(role, places[role], answers):
            _tell_who(role, places[role], answers, held)
    values, remarks = _instruments(places, answers, held)
    if laser_commands is not None:
        values["laser"]["commands"] = _readable_table(values["laser"], laser_commands)
    with_fibre = "Ports of the chip that have a fibre, such as 2-6; 0 is the fibre before it"
    if (wired := _asked(asking, with_fibre, ports, EVERY_PORT, _check_ports)) != EVERY_PORT:
        values["patch_panel"]["ports"] = wired
    never = "Optical power that must never be exceeded"
    bound = _asked(asking, never, optical_power, "30 mW", _check_bound)
    values["limits"] = {"optical_power": bound, "rf_amplitude": "0.5 V"}
    values["laser"] |= _power_below(bound)
    if quantity(bound, "W") > MOST_OF_CLASS_3B_W:
        tell(f"{never}: {bound} is more than a laser of class 3B has, {MOST_OF_CLASS_3B_W:g} W: is it what you mean?")
    wired_for_bursts = burst or (asking and confirm("Are DMD, AWG and oscilloscope wired for hardware-timed bursts?"))
    values["wiring"] = {"burst": wired_for_bursts}
    called = _asked(asking, "Name of the bench", name, file.stem, lambda text: Station(name=text))
    schema = file.with_name(file_name(STATION))
    _write(file, draft(values, remarks, name=called, schema=schema.name), schema)
    spoken_to = [role for role, place in places.items() if "::" in place]
    spoken_to += [place for place in addresses or [] if place not in places.values()]
    result = {
        "station": str(file),
        "schema": str(schema),
        "instruments": {role: values[role] for role in TITLES},
        "absent": [role for role, place in places.items() if not place],
        "silent": [one for one in spoken_to if (at := places.get(one, one)) not in held and not _at(at, answers)],
        "held": held,
        "others": [
            {"address": answer.address, "identity": answer.who}
            for answer in answers
            if answer.address not in places.values()
        ],
        "not_asked": [place for place in listed if place.startswith(SERIAL) and place not in named],
        "next": f"labctl check --station {file}",
    }
    show(result, as_json, lambda: _print(result))
    return DONE


def _who_is_at(addresses: Iterable[str]) -> tuple[list[Answer], dict[str, str]]:
    """Who answers where; and who holds the other addresses, which are not spoken to."""
    answers: list[Answer] = []
    held: dict[str, str] = {}
    for address in dict.fromkeys(addresses):
        try:
            with held_alone(address, "labctl init"):
                answers += answers_at([address])
        except BenchInUse as error:
            held[address] = error.holder or str(error)
        except InstrumentInUse:
            held[address] = "another program, maybe of another computer, by the instrument's own lock"
    return answers, held


def _asked(asking: bool, question: str, said: str | None, default: str, check: Callable[[str], object]) -> str:
    if said is not None:
        return said
    return ask(question, default, check) if asking else default


def _by_hand(role: str) -> str:
    """The driver of an instrument that a person sets; empty if there is none."""
    return next((name for name, found in installed(role).items() if found.by_hand), "")


def _words(role: str) -> tuple[str, ...]:
    """What may stand in the place of an address, besides `simulated`."""
    return (*((MANUAL,) if _by_hand(role) else ()), *((USB,) if role == "dmd" else ()))


def _check_place(role: str, place: str) -> None:
    words = (SIMULATED, *_words(role))
    if not place or place in words:
        return
    if "::" not in place:
        raise ValueError(f"{place!r} is no address: write one such as {EXAMPLE}, or {' or '.join(words)}")
    InstrumentSection(driver=USUAL[role], address=place)


def _require_place(role: str, place: str) -> None:
    try:
        _check_place(role, place)
    except ValueError as error:
        told = describe(error) if isinstance(error, ValidationError) else str(error)
        raise UsageError(f"--{role.replace('_', '-')}: {told}") from None


def _check_ports(ports: str) -> None:
    PatchPanelSection.model_validate({"driver": USUAL["patch_panel"], "ports": ports})


def _check_bound(power: str) -> None:
    LimitsSection.model_validate({"optical_power": power})


def _readable_table(laser: Mapping[str, Any], table: Path) -> str:
    """What the section of the laser says of its command table."""
    found = driver("laser", laser["driver"])
    if "commands" not in found.section.model_fields:
        raise UsageError("--laser-commands: this laser has no command table: leave it out")
    if str(table) == SIMULATED:
        return SIMULATED
    try:
        found.ranges(found.section.model_validate({**laser, "commands": table.absolute()}))
    except NotConfigured as error:
        raise UsageError(f"--laser-commands: {error}") from None
    return str(table.absolute())


def _at(place: str, answers: list[Answer]) -> Answer | None:
    return next((answer for answer in answers if answer.address == place), None)


def _is_another(role: str, place: str, answers: list[Answer]) -> bool:
    answer = _at(place, answers)
    return answer is not None and answer.instrument != role


def _tell_who(role: str, place: str, answers: list[Answer], held: Mapping[str, str]) -> None:
    if "::" not in place:
        return
    if place in held:
        tell(f"  held by {held[place]}")
    elif (answer := _at(place, answers)) is None:
        tell("  nobody answers there now")
    elif answer.instrument == role:
        tell(f"  {' '.join(answer.who.split())}")
    else:
        tell(f"  {place}: {' '.join(answer.who.split())}: not what labctl knows as {TITLES[role]}")


def _instruments(
    places: dict[str, str], answers: list[Answer], held: Mapping[str, str]
) -> tuple[dict[str, dict[str, Any]], dict[str, tuple[str, ...]]]:
    """Driver and address of each, and what is to be known of it."""
    values: dict[str, dict[str, Any]] = {}
    remarks: dict[str, tuple[str, ...]] = {}
    for role, place in places.items():
        answer = _at(place, answers)
        if place == MANUAL:
            values[role] = {"driver": _by_hand(role)}
            continue
        known = answer.driver if answer and answer.instrument == role else USUAL[role]
        values[role] = {"driver": known, "address": place}
        if answer is not None:
            remarks[role] = (f"Answered here: {' '.join(answer.who.split())}.",)
        elif not place:
            remarks[role] = (ABSENT,)
        elif place in held:
            remarks[role] = ("Another program had it open when this file was written: it was not asked who it is.",)
        elif place not in (SIMULATED, USB):
            remarks[role] = ("Did not answer when this file was written.",)
    speaks_table = driver("laser", values["laser"]["driver"]).section is Tlg220Section
    if speaks_table and "(simulated)" in " ".join(remarks.get("laser", ())):
        values["laser"]["commands"] = SIMULATED
    return values, remarks


def _power_below(bound: str) -> dict[str, str]:
    """The laser's power where its default would exceed the limit."""
    try:
        return {"power": bound} if quantity(bound, "W") < Station().laser.power else {}
    except ValueError as error:
        raise UsageError(f"--optical-power: {error}") from None


def _write(file: Path, text: str, schema: Path) -> None:
    try:
        Station.model_validate(tomllib.loads(text))
    except ValidationError as error:
        raise UsageError(f"{file} would be wrong: {describe(error)}") from None
    write_station(file, text)
    try:
        if not schema.exists():
            write_schema(schema, STATION)
    except OSError as error:
        raise StationError(unwritable(schema, error, "name a file in another folder")) from None


def _print(result: dict[str, Any]) -> None:
    say(f"{result['station']}: written, with {result['schema']} for your editor")
    table(
        ("instrument", "driver", "address"),
        ((role, found["driver"], found.get("address", "by hand")) for role, found in result["instruments"].items()),
    )
    for role in result["absent"]:
        say(f"{role}: not found: write its address into the file")
    for silent in result["silent"]:
        at, wrong = ("at its address", "the address in the file") if silent in TITLES else ("there", "--address")
        say(f"{silent}: nobody answers {at}: check that it is switched on, or correct {wrong}")
    for place, holder in result["held"].items():
        say(f"{place}: held by {holder}; it was not asked who is there")
    for other in result["others"]:
        say(f"{other['address']} answers too: {other['identity']}")
    for port in result["not_asked"]:
        say(f"{port} was not asked who is there: name it by --address if an instrument is")
    say(f"next: {result['next']}")
