"""The station file: a bench described in TOML, checked whole before anything is opened.

Every key is known, every quantity has its unit, every level is inside its limit; otherwise one line says which key of
which file is wrong and what to do.
"""

import json
import os
from collections.abc import Mapping
from errno import EEXIST
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeInt,
    PositiveInt,
    SerializeAsAny,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from instruments.alnair_tlg220 import Tlg220Section
from instruments.driver import Driver
from instruments.remedies import unreadable, unwritable
from instruments.sections import (
    FOLDER,
    SIMULATED,
    AwgSection,
    DmdSection,
    InstrumentSection,
    LaserSection,
    PatchPanelSection,
    ScopeSection,
    Section,
    Text,
)
from instruments.toml_files import TomlError, describe, read_toml
from instruments.units import WITH_UNITS, Seconds, Volts, Watts
from labctl.bench.drivers import driver, installed
from labctl.errors import StationError
from labctl.runs.format.durable import replace_file

USUAL = {
    "awg": "tektronix-awg70002a",
    "scope": "tektronix-dpo72504dx",
    "laser": "alnair-tlg-220",
    "dmd": "vialux-alp",
    "patch_panel": "scpi-fibre-switch",
}
"""The instruments that every bench has, and the driver of each where its section names none."""

ONCE_COMMON = {
    "awg": {"channel", "timeout"},
    "scope": {"timeout"},
    "laser": {"commands"},
    "dmd": {"version", "library", "timeout"},
    "patch_panel": {"timeout"},
}
"""Keys that once belonged to a role, so that every driver of it took them, with a use for them or without.

Station files and manifests of that time have them: a driver that has no such key accepts it and drops it.
"""


class LimitsSection(Section):
    """What must never be exceeded."""

    optical_power: Annotated[Watts, Field(gt=0, description="What laser.power may not exceed.")] = 0.03
    rf_amplitude: Annotated[Volts, Field(gt=0, description="What awg.amplitude may not exceed.")] = 0.5
    detector: Annotated[Volts, Field(gt=0, description="What a detector may show at most.")] = 1.5
    amplified_power: Annotated[Watts, Field(gt=0, description="What may leave the optical amplifier.")] = 0.2


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
    seconds: Annotated[float, Field(gt=0, le=86400, description="How many seconds of measuring it may lose.")] = 1.0


class CalibrationSection(Section):
    """Where `labctl align` keeps what it finds, beside the station file, and how long that is valid."""

    folder: Annotated[Path, Field(description="Folder for what `labctl align` finds, beside this file.")] = Path(
        "calibrations"
    )
    valid: Annotated[Seconds, Field(gt=0, description="Runs warn of a calibration that is older.")] = 7 * 86400.0


class SimSection(Section):
    """The simulated bench: which twin it is (fibre, chip, noise).

    `parameters` are physical parameters that differ from their defaults, for studies of what a result depends on.
    """

    twin_seed: Annotated[NonNegativeInt, Field(description="Which fibre, chip and noise.")] = 1
    noise: Annotated[
        Literal["by-trigger", "by-state"],
        Field(description="New for every trigger; by-state: the same in the same state, for tests, not for results."),
    ] = "by-trigger"
    device: Annotated[
        Literal["cpu", "cuda"],
        Field(description="cuda: computed on a graphics card, if there is one; alike, but not equal to the digit."),
    ] = "cpu"
    parameters: dict[str, float | int | bool | str] = Field(
        {}, description="Physical parameters that differ from their defaults."
    )


def _of_any_driver(section: object, info: ValidationInfo) -> object:
    """The section of an instrument that not every bench has, by the model of its driver, which is known to be there."""
    if isinstance(section, InstrumentSection):
        return section
    if not isinstance(section, Mapping) or not isinstance(section.get("driver"), str):
        raise PydanticCustomError("extra_forbidden", "unknown key")
    return installed()[section["driver"]].section.model_validate(section, context=info.context)


class Station(Section):
    """A bench as its file describes it; `source` is where it came from, for messages.

    The section of an instrument is the one that its driver declares. Besides the instruments that every bench has there
    may be any others that a driver is installed for, each in the table that its driver names.
    """

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, Annotated[SerializeAsAny[InstrumentSection], BeforeValidator(_of_any_driver)]]

    source: str = "built-in station"
    name: Text = "simulated bench"
    mixed: Annotated[bool, Field(description="Real and simulated instruments on one bench are intended.")] = False
    awg: SerializeAsAny[AwgSection] = Field(default_factory=dict, validate_default=True)
    scope: SerializeAsAny[ScopeSection] = Field(default_factory=dict, validate_default=True)
    laser: SerializeAsAny[LaserSection] = Field(default_factory=dict, validate_default=True)
    dmd: SerializeAsAny[DmdSection] = Field(default_factory=dict, validate_default=True)
    patch_panel: SerializeAsAny[PatchPanelSection] = Field(default_factory=dict, validate_default=True)
    limits: LimitsSection = LimitsSection()
    wiring: WiringSection = WiringSection()
    durability: DurabilitySection = DurabilitySection()
    calibration: CalibrationSection = CalibrationSection()
    sim: SimSection = SimSection()

    @model_validator(mode="before")
    @classmethod
    def _others_have_drivers(cls, values: object) -> object:
        """A table besides those that every station has must name a driver that is for it.

        Raises:
            StationError: it names none, or one that is not installed, or not for this table.
        """
        if isinstance(values, Mapping):
            for role in values.keys() - cls.model_fields.keys():
                if isinstance(section := values[role], Mapping):
                    if isinstance(name := section.get("driver"), str):
                        driver(role, name)
                    elif known := installed(role):
                        raise StationError(f"{role}.driver is missing: choose one of {', '.join(known)}")
        return values

    @field_validator(*USUAL, mode="before")
    @classmethod
    def _as_its_driver_reads_it(cls, section: object, info: ValidationInfo) -> object:
        """The section by the model of the driver that it names; anything but a table is left to pydantic.

        Raises:
            StationError: there is no such driver.
        """
        if not isinstance(section, Mapping):
            return section
        role = str(info.field_name)
        whole = {"driver": USUAL[role], **section}
        name = whole["driver"] if isinstance(whole["driver"], str) else USUAL[role]
        model = driver(role, name).section
        kept = {
            key: value
            for key, value in whole.items()
            if key in model.model_fields or key not in ONCE_COMMON.get(role, ())
        }
        return model.model_validate(kept, context=info.context)

    @property
    def others(self) -> Mapping[str, InstrumentSection]:
        """The sections of the instruments that not every bench has."""
        return self.__pydantic_extra__

    @property
    def roles(self) -> tuple[str, ...]:
        """Every instrument by name."""
        return (*USUAL, *self.others)

    def section_of(self, role: str) -> InstrumentSection:
        """What the file says of an instrument."""
        section: InstrumentSection = getattr(self, role)
        return section

    def driver_of(self, role: str) -> Driver[Any]:
        """The driver of an instrument.

        Raises:
            StationError: it is not installed any more.
        """
        return driver(role, self.section_of(role).driver)

    @property
    def addresses(self) -> dict[str, str]:
        """Instrument -> VISA address."""
        return {role: self.section_of(role).address for role in self.roles}

    @property
    def by_hand(self) -> tuple[str, ...]:
        """The instruments that a person sets."""
        return tuple(role for role in self.roles if self.driver_of(role).by_hand)

    @property
    def simulations(self) -> tuple[str, ...]:
        """The instruments that a simulated bench in this process stands in for."""
        by_hand = self.by_hand
        return tuple(role for role, address in self.addresses.items() if address == SIMULATED and role not in by_hand)

    @property
    def simulated(self) -> bool:
        """Whether any instrument is one of a simulated bench in this process."""
        return bool(self.simulations)

    @property
    def wholly_simulated(self) -> bool:
        """Whether every instrument is one of a simulated bench in this process."""
        return len(self.simulations) == len(self.addresses)

    @property
    def partly_simulated(self) -> bool:
        """Whether some instruments are there and others simulated; those that a person sets are neither."""
        there = self.addresses.keys() - self.simulations - set(self.by_hand)
        return bool(self.simulations and there)

    def twin(self, seed: int) -> "Station":
        """This bench with another twin behind its simulated instruments."""
        return self.model_copy(update={"sim": self.sim.model_copy(update={"twin_seed": seed})})

    def with_parameters(self, parameters: Mapping[str, float | int | bool | str]) -> "Station":
        """This bench with other physical parameters behind its simulated instruments."""
        changed = {**self.sim.parameters, **parameters}
        return self.model_copy(update={"sim": self.sim.model_copy(update={"parameters": changed})})

    def cabled(self, *, projector: bool) -> "Station":
        """This bench with the light's way changed; see `WiringSection`."""
        return self.model_copy(update={"wiring": self.wiring.model_copy(update={"projector": projector})})


SIMULATED_STATION = Station(wiring=WiringSection(burst=True))
"""What is used where no station file is named: every instrument simulated, every cable there."""


def read_station(path: Path | None) -> Station:
    """Read a station file; without one, the simulated bench. Files that it names are looked for beside it.

    Raises:
        StationError: the file cannot be read or is wrong anywhere.
    """
    if path is None:
        return SIMULATED_STATION
    try:
        str(path).encode()
    except UnicodeEncodeError:  # a manifest could not name it
        raise StationError(f"{path}: this name is not UTF-8: rename that file or folder") from None
    try:
        return Station.model_validate(
            read_toml(path) | {"source": str(path)}, context={FOLDER: path.parent, WITH_UNITS: True}
        )
    except OSError as error:
        raise StationError(unreadable(path, error, "name a station file")) from None
    except TomlError as error:
        raise StationError(f"{path}: is not TOML ({error}): correct that line") from None
    except ValidationError as error:
        raise StationError(f"{path}: {describe(error, _keys())}") from None
    except StationError as error:
        raise StationError(f"{path}: {error}") from None


def _keys() -> set[str]:
    """Every key that some table of some station has."""
    tables: list[type[BaseModel]] = [Station, *(found.section for role in USUAL for found in installed(role).values())]
    tables += [LimitsSection, WiringSection, DurabilitySection, CalibrationSection, SimSection]
    return {key for table in tables for key in table.model_fields}


def write_addresses(path: Path, addresses: Mapping[str, str], station: Station = SIMULATED_STATION) -> None:
    """Write a station file: what `station` says, with its instruments at `addresses`.

    A laser with a command table is the simulated one unless `station` names a table; it is armed, since nothing shines
    there.

    Raises:
        StationError: the file exists or cannot be written, or nothing says which driver one of them has.
    """
    if unknown := [role for role in addresses if role not in station.roles]:
        raise StationError(
            f"{path}: not written: nothing says which driver {', '.join(unknown)} has: leave --save-station out, and "
            f"write the addresses into the station file of that bench"
        )
    whole = station.model_dump(mode="json", exclude_defaults=True, exclude={"source"}, context={WITH_UNITS: True})
    for role, address in addresses.items():
        files = {key: value for key, value in station.section_of(role) if isinstance(value, Path)}
        whole[role] |= {key: str(file.absolute()) for key, file in files.items() if str(file) != SIMULATED}
        whole[role]["address"] = address
    if isinstance(station.laser, Tlg220Section) and station.laser.commands is None:
        whole["laser"]["commands"] = SIMULATED
    whole["laser"]["armed"] = True
    lines = [f"{key} = {toml(value)}" for key, value in whole.items() if not isinstance(value, dict)]
    for section, values in whole.items():
        if isinstance(values, dict):
            lines += ["", f"[{section}]", *(f"{key} = {toml(value)}" for key, value in values.items())]
    write_station(path, "\n".join(lines).lstrip() + "\n")


def write_station(path: Path, text: str) -> None:
    """Write a new station file, all or nothing: half of one describes a bench with other limits.

    Raises:
        StationError: the file exists or cannot be written.
    """
    if os.path.lexists(path):
        raise _not_written(path, FileExistsError(EEXIST, os.strerror(EEXIST)))
    replace_file(path, text.encode(), _not_written)


def _not_written(path: Path, error: OSError) -> StationError:
    return StationError(unwritable(path, error, "name a new file"))


def toml(value: object) -> str:
    """A value of a station file as TOML; JSON writes text, numbers, truth and lists in the same way."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(part)}" for key, part in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # which JSON leaves, and TOML forbids
