"""Every number of the simulated bench in one frozen model: default, unit, and the physical reason for it.

Nothing here depends on an experiment or on data: the same values serve every protocol. Quantities that follow from
others (mode counts, delay spread, speckle grain, power transmissions) are properties, so that they cannot be paired
at will.
"""

import math
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

PLANCK = 6.62607015e-34
SPEED_OF_LIGHT = 299_792_458.0
_DRIFT_STEPS = 200  # in the time of a drift: from one to the next a hundredth of the power is new


def quantity(default: object, unit: str, reason: str, **limits: float) -> Any:
    """A model field with its unit ("1" for pure numbers, "-" for words) and its physical reason."""
    return Field(default=default, description=reason, json_schema_extra={"unit": unit}, **limits)  # type: ignore[call-overload]


def power_ratio(db: float) -> float:
    """Power ratio of `db` decibel."""
    return float(10.0 ** (db / 10.0))


class Parameters(BaseModel):
    """The physics of the simulated bench.

    The power budget follows from these (`sim_backends.optics.budget`): of 30 mW some 0.2 W reach the mirrors behind a
    booster, of which one mode of the collecting fibre takes tens of microwatts with every mirror on and a few for a
    handwritten digit, a thousand photons and more in 40 ps. The preamplifier makes milliwatts of them, spot-size
    converter, cavity and facet take 20 dB, and a detector sees tens of microwatts. Without amplifiers it would be some
    ten nanowatts, far below the detector's own noise of 2.7 uW: the set-up has some, whether named or not.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    # drive and modulator
    awg_bandwidth_hz: float = quantity(
        14e9, "Hz", "Output stage of the generator, one pole: direct path, -3 dB at 13 to 15 GHz.", gt=0
    )
    rf_gain: float = quantity(
        17.8, "1", "RF driver, 25 dB: the generator gives 0.5 Vpp, uniform phases over 2 pi need 2 V_pi = 8 Vpp.", gt=0
    )
    rf_saturation_v: float = quantity(
        8.0, "V", "Peak output at which the RF driver saturates (tanh): 0.5 Vpp come out as 8.1 Vpp, 2.02 V_pi.", gt=0
    )
    v_pi_v: float = quantity(4.0, "V", "Half-wave voltage of the LiNbO3 phase modulator, 3.5 to 5 V at 1 GHz.", gt=0)
    modulator_bandwidth_hz: float = quantity(16e9, "Hz", "Electro-optic bandwidth, one pole: vendor class.", gt=0)
    modulator_loss_db: float = quantity(3.5, "dB", "Insertion loss of the modulator with its isolator.", ge=0)
    awg_jitter_s: float = quantity(
        250e-15,
        "s",
        "Clock jitter of the generator, rms: of the class. Most of it is slower than a record of nanoseconds, which it "
        "shifts as a whole.",
        ge=0,
    )
    drive_step_s: float = quantity(
        5e-12, "s", "Largest step of the grid the light's envelope is computed on: 200 GHz against 16 GHz.", gt=0
    )
    light_path: Literal["projector", "direct"] = quantity(
        "projector",
        "-",
        "projector: modulator, fibre, mirrors, collection, amplifier, chip. direct: modulator straight into the chip, "
        "as for time series; no fibre, mirrors, collection or amplifier.",
    )
    path_delay_s: float = quantity(
        98e-9 - 20.0 * 1.4626 / SPEED_OF_LIGHT,
        "s",
        "Marker edge to the light it belongs to, but for the multimode fibre, whose transit follows from its length, "
        "or the direct lead: leads less the marker's cable, below 0 where that is the longer. A stated guess: with the "
        "fibre's 97.6 ns it makes 98 ns.",
    )
    direct_lead_s: float = quantity(
        1.24e-9,
        "s",
        "What lies in the place of the projector where the light path is direct: a lead of 25 cm. A stated guess: 1.67 "
        "ns with `path_delay_s`.",
        ge=0,
    )

    # multimode fibre and the image of its end on the mirrors
    design_wavelength_nm: float = quantity(1550.0, "nm", "Where mode count and speckle grain are evaluated.", gt=0)
    core_diameter_m: float = quantity(200e-6, "m", "Step-index multimode fibre.", gt=0)
    fibre_na: float = quantity(0.39, "1", "Numerical aperture of the fibre.", gt=0, lt=1)
    launch_na: float = quantity(
        0.13,
        "1",
        "Aperture the single-mode lead fills: modes, delay spread and speckle grain all follow from it. Weak mixing "
        "over 20 m keeps it well below the fibre's 0.39; the delay spread of 0.40 ns agrees with a decorrelation "
        "within 0.02 nm.",
        gt=0,
        lt=1,
    )
    launch_profile: Literal["filled", "gaussian"] = quantity(
        "gaussian",
        "-",
        "How the launch fills its aperture: as the Gaussian far field of a single-mode lead, launch_na at 1/e^2, as in "
        "the paper, or evenly up to launch_na.",
    )
    fibre_length_m: float = quantity(20.0, "m", "Length of the multimode fibre.", gt=0)
    fibre_index: float = quantity(1.444, "1", "Silica at 1550 nm.", gt=1)
    fibre_group_index: float = quantity(1.4626, "1", "Silica at 1550 nm, n - lambda dn/dlambda (Malitson 1965).", gt=1)
    fibre_loss_db: float = quantity(1.0, "dB", "Launch and end facets of the multimode fibre.", ge=0)
    image_side: float = quantity(
        0.2,
        "1",
        "Side of the 28x28 square as a part of the imaged core diameter: 40 um of the core, inside its flat middle. "
        "With the launch aperture it sets the speckle grain, 4.4 superpixels. The one number that is fitted to the "
        "paper, to the curve of figure 3 with single triggers: labctl reproduce fig3 --fit.",
        gt=0,
        le=0.7,
    )
    fibre_drift_correlation: float = quantity(
        1.0,
        "1",
        "What is left of the field's correlation after `fibre_drift_time_s`: temperature and strain change the phases "
        "of the modes. 1: the fibre stands still.",
        gt=0,
        le=1,
    )
    fibre_drift_time_s: float = quantity(44e-3, "s", "1000 pictures of a burst, 44 us each.", gt=0)

    # mirrors and collection
    mirror_loss_db: float = quantity(4.0, "dB", "Diffraction efficiency 50 % at 1550 nm, fill factor, window.", ge=0)
    mirror_contrast: float = quantity(
        1000.0,
        "1",
        "Power of a mirror that is on over what it scatters towards the fibre while it is off: full on over full off "
        "of the class, 1000 to 2000 in visible light.",
        gt=1,
    )
    mirror_leaves_s: float = quantity(0.5e-6, "s", "Mirrors start to move this long after the reset pulse.", ge=0)
    mirror_arrives_s: float = quantity(1.5e-6, "s", "All mirrors have landed: crossover takes about 1 us.", gt=0)
    collection_core_m: float = quantity(50e-6, "m", "Collecting multimode fibre.", gt=0)
    collection_na: float = quantity(
        0.22, "1", "Aperture of the collecting fibre: 129 modes a polarisation.", gt=0, lt=1
    )
    collection_image: float = quantity(
        1.42,
        "1",
        "Diameter of the collecting core's image on the mirrors, in sides of the square: just around it.",
        gt=0,
    )
    collecting_modes: int = quantity(
        42,
        "1",
        "Modes of the collecting fibre, the lowest ones, that the collected mode is a random sum of: what a "
        "single-mode lead at its other end fills, by reciprocity those within the same 0.13 as at the launch. 1: the "
        "fundamental mode, smooth; 129: all, a speckle as fine as the fibre can make.",
        ge=1,
    )
    collected_modes: int = quantity(
        1,
        "1",
        "Orthogonal collected modes that reach the amplifier, added as powers: one, because amplifier and chip are "
        "single-mode.",
        ge=1,
    )

    # optical amplifiers: booster behind the modulator, preamplifier between collection and chip
    booster_gain_db: float = quantity(
        12.0,
        "dB",
        "Gain behind the modulator, where light is strong and amplifier noise does not matter: every dB here in place "
        "of one of the preamplifier's lets a dB more photons survive to it. 12 dB on 11 dBm is a common 23 dBm "
        "booster; without it a sample has some 100 photons before the chip and 1 point less accuracy. Its own ASE is "
        "left out.",
        ge=0,
    )
    amplifier_gain_db: float = quantity(
        30.0,
        "dB",
        "Brings the detectors to some 50 uW for a handwritten digit, against 2.7 uW of their own noise.",
        ge=0,
    )
    amplifier_noise_figure_db: float = quantity(
        4.5, "dB", "Erbium preamplifier, quantum limit 3 dB; photons in front of it, not at the detector, count.", ge=3
    )
    amplifier_saturation_w: float = quantity(
        20e-3,
        "W",
        "Output at which the preamplifier's gain has fallen by half, 13 dBm: of the class. Picture by picture: an "
        "amplifier that is slower than a burst's 44 us would follow their mean.",
        gt=0,
    )
    amplifier_filter_hz: float = quantity(
        100e9, "Hz", "Optical filter behind the amplifier, 0.8 nm: passes the modulation, keeps most ASE out.", gt=0
    )

    # chip
    stadium_radius_m: float = quantity(25e-6, "m", "Radius of the stadium's half circles.", gt=0)
    stadium_straight_m: float = quantity(100e-6, "m", "Straight part of the stadium: area 6963 um^2.", gt=0)
    chip_index: float = quantity(2.85, "1", "Effective index of the 220 nm silicon slab, TE0.", gt=1)
    chip_group_index: float = quantity(
        3.70, "1", "Group index of the same slab, solved with the dispersion of silicon: sets the mode density.", gt=1
    )
    chip_ports: int = quantity(14, "1", "Single-mode waveguides at the cavity.", ge=2)
    chip_input_port: int = quantity(10, "1", "Waveguide the light enters by.", ge=1)
    chip_coupling: float = quantity(
        0.9, "1", "Transmission between a waveguide and the cavity: escape lifetime 79 ps through 14 ports.", gt=0, le=1
    )
    chip_loss_lifetime_s: float = quantity(
        200e-12,
        "s",
        "Photon lifetime by wall scattering and absorption alone, an open question: rays in a bare stadium of this "
        "slab live 3 to 5 ps, most of their bounces being below the critical angle. 200 ps are walls that reflect. "
        "labctl reproduce fig3 --sensitivity says what each value does.",
        gt=0,
    )
    chip_modes: int = quantity(320, "1", "Resonances computed: +-200 GHz at one per GHz, the drive fills +-40.", ge=50)
    spot_size_converter_loss_db: float = quantity(3.0, "dB", "Fibre to waveguide.", ge=0)
    facet_loss_db: float = quantity(3.0, "dB", "Waveguide to fibre at an output port.", ge=0)
    bypass_attenuation_db: float = quantity(
        20.0,
        "dB",
        "Fixed attenuator in the lead that goes past the chip: the same level as behind the chip; 5 mW would "
        "overdrive the detector.",
        ge=0,
    )

    # detectors and oscilloscope
    detector_bandwidth_hz: float = quantity(12e9, "Hz", "Photodetector with amplifier, one pole.", gt=0)
    detector_gain_v_per_w: float = quantity(600.0, "V/W", "Conversion gain into 50 ohm.", gt=0)
    detector_responsivity_a_per_w: float = quantity(0.9, "A/W", "InGaAs at 1550 nm.", gt=0)
    detector_nep_w_per_rthz: float = quantity(
        24e-12, "W/rtHz", "Noise-equivalent power: 2.7 uW in 12.6 GHz, 1.6 mV.", ge=0
    )
    detector_limit_v: float = quantity(
        1.0, "V", "Output the detector's amplifier cannot exceed; it is 1 dB short where it would give this much.", gt=0
    )
    detector_coupling: Literal["dc", "ac"] = quantity(
        "dc", "-", "ac takes the mean over the drive's period away, and with it the brightness of an image."
    )
    laser_rin_db_per_hz: float = quantity(-150.0, "dB/Hz", "Relative intensity noise: 0.4 % rms, negligible.")
    scope_bandwidth_hz: float = quantity(25e9, "Hz", "Oscilloscope, Gaussian response.", gt=0)
    record_step_s: float = quantity(
        10e-12, "s", "Largest step of the grid intensities are computed on: 100 GHz against 12 GHz.", gt=0
    )
    enob: float = quantity(
        5.5,
        "bit",
        "Effective bits of the 8-bit digitiser at full bandwidth: of the class.",
        gt=0,
        le=8,
    )
    enob_of_12_bits: float = quantity(
        6.8,
        "bit",
        "Effective bits of a 12-bit digitiser (6 Series B) at 10 GHz: recalled of the class, 6.5 to 7.",
        gt=0,
        le=12,
    )
    trigger_jitter_s: float = quantity(1.2e-12, "s", "Trigger jitter, rms, of this class of oscilloscope.", ge=0)
    shared_reference: bool = quantity(
        default=True,
        unit="-",
        reason="Generator and oscilloscope run from one 10 MHz: the sampling grid does not slip against the drive.",
    )

    # slow changes
    laser_wander_hz: float = quantity(
        0.0, "Hz", "Rms laser detuning. What counts is its part of 1 / (0.4 ns) of delay spread.", ge=0
    )
    chip_wander_hz: float = quantity(
        0.0,
        "Hz",
        "Rms detuning of the chip's resonances (about 10 GHz/K). What counts is its part of their 3 GHz.",
        ge=0,
    )
    wander_time_s: float = quantity(
        10.0, "s", "Time over which either detuning forgets what it was: thermal time of a mount.", gt=0
    )
    laser_tuning_s: float = quantity(1.0, "s", "Time for which a tuning laser stays dark.", ge=0)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.launch_na > self.fibre_na:
            raise ValueError(f"launch_na {self.launch_na} exceeds fibre_na {self.fibre_na}: the fibre cannot guide it")
        if self.mirror_arrives_s <= self.mirror_leaves_s:
            raise ValueError("mirror_arrives_s must be later than mirror_leaves_s: mirrors need time to move")
        if self.collected_modes > self.collecting_modes:
            raise ValueError(
                f"collected_modes {self.collected_modes} exceeds collecting_modes {self.collecting_modes}: "
                "no more modes can be collected than there are"
            )
        if self.chip_input_port > self.chip_ports:
            raise ValueError(f"chip_input_port {self.chip_input_port} is not among the {self.chip_ports} ports")
        return self

    @property
    def projector_transmission(self) -> float:
        """Power transmission from the laser to the mirrors and off them, overlap with the collected mode left out."""
        return power_ratio(self.booster_gain_db - self.modulator_loss_db - self.fibre_loss_db - self.mirror_loss_db)

    @property
    def fibre_coherence_s(self) -> float:
        """Time over which the correlation of a drifting fibre's field falls to 1/e (s); infinite without drift."""
        if self.fibre_drift_correlation == 1:
            return math.inf
        return self.fibre_drift_time_s / -math.log(self.fibre_drift_correlation)

    @property
    def drift_step_s(self) -> float:
        """Virtual time for which what drifts is taken to stand still (s): a small part of the fastest drift's time."""
        wanders = self.laser_wander_hz > 0 or self.chip_wander_hz > 0
        return min(self.fibre_coherence_s, self.wander_time_s if wanders else math.inf) / _DRIFT_STEPS

    @property
    def amplifier_gain(self) -> float:
        """Power gain of the preamplifier; 1 without it."""
        return power_ratio(self.amplifier_gain_db)

    @property
    def ase_density(self) -> float:
        """ASE behind the amplifier, one polarisation (W/Hz): S = n_sp h nu (G - 1), n_sp = F / 2.

        Saleh & Teich, ch. 15 (amplifier noise), with the noise figure's large-gain limit F = 2 n_sp.
        """
        photon = PLANCK * SPEED_OF_LIGHT / (self.design_wavelength_nm * 1e-9)
        return power_ratio(self.amplifier_noise_figure_db) / 2 * photon * (self.amplifier_gain - 1)

    @property
    def light_delay_s(self) -> float:
        """Marker edge to light (s): leads and cables, and the multimode fibre's transit or the direct lead."""
        if self.light_path == "direct":
            return self.path_delay_s + self.direct_lead_s
        return self.path_delay_s + self.fibre_length_m * self.fibre_group_index / SPEED_OF_LIGHT
