"""The station file: a bench described in TOML, checked whole before anything is opened.

Every key is known, every quantity has its unit, every level is inside its limit; otherwise one line says which key of
which file is wrong and what to do.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, PositiveInt, ValidationError

from instruments.toml_files import TomlError, describe, one_line, read_toml
from instruments.units import Nanometres, Seconds, Volts, Watts
from labctl.errors import StationError
from protocols.settings import Ports

SIMULATED = "simulated"
BY_HAND = ("manual-laser", "manual-patch-panel")
"""Drivers of instruments that have no address: a person sets them."""


class Section(BaseModel):
    """A table of the station file: unknown keys are errors, and so are nan, which passes any limit, and infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _one_line(text: str) -> str:
    if not one_line(text):
        raise ValueError("does not fit on one line: write it without control characters")
    return text


def _address(text: str) -> str:
    if not text or not text.isascii() or set(text) & set(";\"'"):
        raise ValueError("is no address: write one as VISA does, without quotes and semicolons")
    return text


Text = Annotated[str, Field(max_length=200), AfterValidator(_one_line)]
Address = Annotated[Text, AfterValidator(_address), Field(description='VISA resource, or "simulated".')]
Driver = Annotated[Text, Field(description="Which driver: an entry point of the group labctl.instruments.")]
Channel = Annotated[int, Field(ge=1, le=4)]
Channels = Annotated[tuple[Channel, ...], Field(min_length=1, description="Channels that carry detectors.")]
_Auxiliary = Annotated[str, Field(pattern="^([Aa][Uu][Xx]|[Aa][Uu][Xx][Ii][Ll][Ii][Aa][Rr][Yy])$")]
Timeout = Annotated[Seconds, Field(gt=0, description="Bound on every reply.")]


def _by_source(value: object) -> object:
    return "AUX" if isinstance(value, str) and value.upper() in ("AUX", "AUXILIARY") else value


class AwgSection(Section):
    """The arbitrary waveform generator."""

    driver: Driver = "tektronix-awg70002a"
    address: Address = SIMULATED
    channel: Annotated[Literal[1, 2], Field(description="Channel that plays the drive.")] = 1
    amplitude: Annotated[Volts, Field(description="Of the drive, peak to peak.")] = 0.5
    timeout: Timeout = 5.0


class ScopeSection(Section):
    """The oscilloscope and what triggers it."""

    driver: Driver = "tektronix-dpo72504dx"
    address: Address = SIMULATED
    channels: Channels = (1, 2, 3, 4)
    trigger_source: Annotated[
        Literal["AUX"] | Channel,
        BeforeValidator(_by_source, json_schema_input_type=_Auxiliary | Channel),
        Field(description="AUX or a channel."),
    ] = "AUX"
    trigger_level: Annotated[Volts, Field(description="Level that triggers.")] = 0.5
    trigger_slope: Annotated[Literal["rise", "fall"], Field(description="Edge that triggers.")] = "rise"
    timeout: Timeout = 10.0


class LaserSection(Section):
    """The light source.

    `commands` is the operator's command table, or "simulated" for the simulated laser's; without it the driver's own.
    `armed` allows light.
    """

    driver: Driver = "alnair-tlg-220"
    address: Address = SIMULATED
    commands: Annotated[
        Path | None, Field(description="File with the laser's commands; without it the driver's own table.")
    ] = None
    armed: Annotated[bool, Field(description="Light may be switched on.")] = False
    power: Annotated[Watts, Field(description="Optical output power.")] = 0.03
    wavelength: Annotated[Nanometres, Field(description="For the record: every protocol sets its own.")] = 1550.0


class DmdSection(Section):
    """The micromirror device. `version` and `library` name the vendor's ALP library on a real bench."""

    driver: Driver = "vialux-alp"
    address: Annotated[Address, Field(description='VISA resource, "usb", or "simulated".')] = SIMULATED
    version: Annotated[Text, Field(description="Version of the vendor's ALP library.")] = "4.3"
    library: Annotated[
        Text | None, Field(description="Folder of the vendor's ALP library; without it the system's.")
    ] = None
    timeout: Timeout = 5.0


class PatchPanelSection(Section):
    """What connects the chip to the oscilloscope; `ports` are the waveguides that are wired, 0 the fibre before it.

    With `bypass` the fibre that would enter the chip is wired to the oscilloscope instead, and every run measures that.
    """

    driver: Driver = "scpi-fibre-switch"
    address: Address = SIMULATED
    ports: Annotated[Ports, Field(description="Waveguides that have a fibre; 0 is the fibre before the chip.")] = tuple(
        port for port in range(15) if port != 10
    )
    bypass: Annotated[bool, Field(description="The fibre that would enter the chip is wired to the first channel.")] = (
        False
    )
    timeout: Timeout = 5.0


class LimitsSection(Section):
    """What must never be exceeded."""

    optical_power: Annotated[Watts, Field(description="What laser.power may not exceed.")] = 0.03
    rf_amplitude: Annotated[Volts, Field(description="What awg.amplitude may not exceed.")] = 0.5
    detector: Annotated[Volts, Field(gt=0, description="What a detector may show at most.")] = 1.5


class WiringSection(Section):
    """How the bench is cabled.

    `burst`: DMD frame sync to AWG trigger and AWG marker to the oscilloscope. `projector`: the light goes through the
    multimode fibre and by the DMD; without it, from the modulator straight into the chip, as for time series.
    """

    burst: Annotated[bool, Field(description="DMD frame sync to AWG trigger, AWG marker to oscilloscope.")] = False
    projector: Annotated[
        bool, Field(description="Fibre and DMD are in the light's way; false: straight into the chip.")
    ] = True


class DurabilitySection(Section):
    """How much a killed process may lose: so many shots, or so many seconds."""

    shots: Annotated[PositiveInt, Field(description="How many shots a killed process may lose.")] = 20
    seconds: Annotated[float, Field(gt=0, description="How many seconds of measuring it may lose.")] = 1.0


class CalibrationSection(Section):
    """Where `labctl align` keeps what it finds, beside the station file, and how long that stands."""

    folder: Annotated[Path, Field(description="Folder of what `labctl align` finds, beside this file.")] = Path(
        "calibrations"
    )
    valid: Annotated[Seconds, Field(gt=0, description="After so long runs say that it is old.")] = 7 * 86400.0


class SimSection(Section):
    """The simulated bench: which twin it is (fibre, chip, noise).

    `parameters` are physical parameters that differ from their defaults, for studies of what a result depends on.
    """

    twin_seed: Annotated[int, Field(description="Which fibre, chip and noise.")] = 1
    parameters: Annotated[
        dict[str, float | int | bool | str], Field(description="Physical parameters that differ from their defaults.")
    ] = {}


class Station(Section):
    """A bench as its file describes it; `source` is where it came from, for messages."""

    source: str = "built-in station"
    name: Text = "simulated bench"
    awg: AwgSection = AwgSection()
    scope: ScopeSection = ScopeSection()
    laser: LaserSection = LaserSection()
    dmd: DmdSection = DmdSection()
    patch_panel: PatchPanelSection = PatchPanelSection()
    limits: LimitsSection = LimitsSection()
    wiring: WiringSection = WiringSection()
    durability: DurabilitySection = DurabilitySection()
    calibration: CalibrationSection = CalibrationSection()
    sim: SimSection = SimSection()

    @property
    def addresses(self) -> dict[str, str]:
        """Instrument -> VISA address."""
        sections = ("awg", "scope", "laser", "dmd", "patch_panel")
        return {section: getattr(self, section).address for section in sections}

    @property
    def simulations(self) -> tuple[str, ...]:
        """The instruments that a simulated bench in this process stands in for."""
        return tuple(
            name
            for name, address in self.addresses.items()
            if address == SIMULATED and getattr(self, name).driver not in BY_HAND
        )

    @property
    def simulated(self) -> bool:
        """Whether any instrument is one of a simulated bench in this process."""
        return bool(self.simulations)

    @property
    def wholly_simulated(self) -> bool:
        """Whether every instrument is one of a simulated bench in this process."""
        return len(self.simulations) == len(self.addresses)

    def twin(self, seed: int) -> "Station":
        """This bench with another twin behind its simulated instruments."""
        return self.model_copy(update={"sim": self.sim.model_copy(update={"twin_seed": seed})})

    def cabled(self, *, projector: bool) -> "Station":
        """This bench with the light's way changed; see `WiringSection`."""
        return self.model_copy(update={"wiring": self.wiring.model_copy(update={"projector": projector})})


SIMULATED_STATION = Station(wiring=WiringSection(burst=True))
"""What is used where no station file is named: every instrument simulated, every cable there."""


def read_station(path: Path | None) -> Station:
    """Read a station file; without one, the simulated bench. The laser's command table is looked for beside the file.

    Raises:
        StationError: the file cannot be read or is wrong anywhere.
    """
    if path is None:
        return SIMULATED_STATION
    try:
        station = Station.model_validate(read_toml(path) | {"source": str(path)})
    except OSError as error:
        raise StationError(f"{path}: cannot be read ({error.strerror}): name a station file") from None
    except TomlError as error:
        raise StationError(f"{path}: is not TOML ({error}): correct that line") from None
    except ValidationError as error:
        raise StationError(f"{path}: {describe(error)}") from None
    table = station.laser.commands
    if table is None or str(table) == SIMULATED:
        return station
    return station.model_copy(update={"laser": station.laser.model_copy(update={"commands": path.parent / table})})


def write_addresses(path: Path, addresses: Mapping[str, str], station: Station = SIMULATED_STATION) -> None:
    """Write a station file: what `station` says, with its instruments at `addresses`.

    The laser is the simulated one unless `station` names a command table; it is armed, since nothing there shines.

    Raises:
        StationError: the file exists or cannot be written.
    """
    whole = station.model_dump(mode="json", exclude_defaults=True, exclude={"source"})
    for name, address in addresses.items():
        whole[name] = whole.get(name, {}) | {"address": address}
    table = station.laser.commands or Path(SIMULATED)
    commands = SIMULATED if str(table) == SIMULATED else str(table.absolute())
    whole["laser"] = whole.get("laser", {}) | {"commands": commands, "armed": True}
    lines = [f"{key} = {toml(value)}" for key, value in whole.items() if not isinstance(value, dict)]
    for section, values in whole.items():
        if isinstance(values, dict):
            lines += ["", f"[{section}]", *(f"{key} = {toml(value)}" for key, value in values.items())]
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write("\n".join(lines).lstrip() + "\n")
    except OSError as error:
        raise StationError(f"{path}: cannot be written ({error.strerror}): name a new file") from None


def toml(value: object) -> str:
    """A value of a station file as TOML; JSON writes text, numbers, truth and lists in the same way."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(part)}" for key, part in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
