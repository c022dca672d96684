"""Sections of the station file: what a bench needs of an instrument, whatever its driver.

A driver takes the section of its role as it is, or derives one with keys of its own.
"""

from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo

from instruments.ports import Ports, require_distinct
from instruments.toml_files import one_line
from instruments.units import Nanometres, Seconds, Volts, Watts

SIMULATED = "simulated"
"""The address of an instrument that a simulated bench in this process stands in for."""
USB: Final = "usb"
"""The address of an instrument behind a vendor's own USB library."""
FOLDER = "folder"
"""Where the validation's context has the folder of the station file."""


def _one_line(text: str) -> str:
    if not one_line(text):
        raise ValueError("does not fit on one line: write it without control characters")
    return text


def _address(text: str) -> str:
    if not text.isascii() or set(text) & set(";\"'"):
        raise ValueError("is no address: write one as VISA does, without quotes and semicolons")
    return text


def _from_the_station_file(path: Path, info: ValidationInfo) -> Path:
    return path if str(path) == SIMULATED or info.context is None else info.context[FOLDER] / path


def _trigger_source(value: object) -> object:
    return "AUX" if isinstance(value, str) and value.upper() in ("AUX", "AUXILIARY") else value


Text = Annotated[str, Field(max_length=200), AfterValidator(_one_line)]
Address = Annotated[
    Text, AfterValidator(_address), Field(description='VISA resource, or "simulated"; empty until somebody knows it.')
]
Timeout = Annotated[Seconds, Field(gt=0, description="Bound on every reply.")]
File = Annotated[Path, AfterValidator(_from_the_station_file)]
"""A file of the instrument: its path from the folder of the station file, or "simulated" for the simulated one's."""
Channel = Annotated[int, Field(ge=1, le=4)]
Channels = Annotated[
    tuple[Channel, ...],
    Field(min_length=1, description="Channels that carry detectors."),
    AfterValidator(require_distinct),
]
_Auxiliary = Annotated[str, Field(pattern="^([Aa][Uu][Xx]|[Aa][Uu][Xx][Ii][Ll][Ii][Aa][Rr][Yy])$")]


class Section(BaseModel):
    """A table of the station file: unknown keys are errors, and so are nan, which passes any limit, and infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class InstrumentSection(Section):
    """An instrument of the bench; `role` is the name of its table, and of the instrument in the bench."""

    role: ClassVar[str]

    driver: Annotated[Text, Field(description="Which driver: an entry point of the group labctl.instruments.")]
    address: Address = SIMULATED
    identity: Annotated[
        Text | None,
        Field(min_length=1, description="Part of maker and model in *IDN?, where the driver does not know them."),
    ] = None


class AwgSection(InstrumentSection):
    """The arbitrary waveform generator."""

    role = "awg"

    amplitude: Annotated[Volts, Field(description="Of the drive, peak to peak.")] = 0.5


class ScopeSection(InstrumentSection):
    """The oscilloscope and what triggers it."""

    role = "scope"

    channels: Channels = (1, 2, 3, 4)
    trigger_source: Annotated[
        Literal["AUX"] | Channel,
        BeforeValidator(_trigger_source, json_schema_input_type=_Auxiliary | Channel),
        Field(description="AUX or a channel."),
    ] = "AUX"
    trigger_level: Annotated[Volts, Field(description="Level that triggers.")] = 0.5
    trigger_slope: Annotated[Literal["rise", "fall"], Field(description="Edge that triggers.")] = "rise"


class LaserSection(InstrumentSection):
    """The light source. `armed` allows light."""

    role = "laser"

    armed: Annotated[bool, Field(description="Light may be switched on.")] = False
    power: Annotated[Watts, Field(description="Optical output power.")] = 0.03
    wavelength: Annotated[
        Nanometres, Field(description="Wavelength of align, live and check --deep; protocols set their own.")
    ] = 1550.0


class DmdSection(InstrumentSection):
    """The micromirror device."""

    role = "dmd"

    address: Annotated[Address, Field(description='VISA resource, "usb", or "simulated".')] = SIMULATED


class PatchPanelSection(InstrumentSection):
    """What connects the chip to the oscilloscope; `ports` are the waveguides that are wired, 0 the fibre before it.

    With `bypass` the fibre that would enter the chip is wired to the oscilloscope instead, and every run measures that.
    """

    role = "patch_panel"

    ports: Annotated[Ports, Field(description="Waveguides that have a fibre; 0 is the fibre before the chip.")] = tuple(
        port for port in range(15) if port != 10
    )
    bypass: Annotated[bool, Field(description="The fibre that would enter the chip is wired to the first channel.")] = (
        False
    )


class PowerMeterSection(InstrumentSection):
    """The optical power meter, behind a tap of the laser's output."""

    role = "power_meter"

    tap: Annotated[float, Field(gt=0, le=1, description="Part of the laser's light that reaches the sensor.")]


class AmplifierSection(InstrumentSection):
    """The optical amplifier between modulator and fibre."""

    role = "amplifier"

    power: Annotated[Watts, Field(gt=0, description="Optical output power.")]


class AttenuatorSection(InstrumentSection):
    """The variable attenuator behind the amplifier and before the fibre."""

    role = "attenuator"

    attenuation_db: Annotated[
        float, Field(ge=0, description="Attenuation (dB) while there is light; otherwise it is shut.")
    ] = 0.0
