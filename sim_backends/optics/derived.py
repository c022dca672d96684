"""What follows from the parameters: numbers of modes, delay spread, speckle grain, density of resonances."""

from sim_backends.optics import cavity, fibre, lp_modes, mirrors
from sim_backends.parameters import Parameters


def fibre_v_number(parameters: Parameters) -> float:
    """V number of the fibre at its full aperture, 158 at the defaults."""
    return lp_modes.v_number(parameters.core_diameter_m / 2, parameters.fibre_na, _wavelength_m(parameters))


def launched_modes(parameters: Parameters) -> int:
    """Modes within the launch aperture, one polarisation: 675 at the defaults."""
    wavelength = _wavelength_m(parameters)
    return fibre.mode_count(
        parameters.core_diameter_m / 2, parameters.fibre_na, wavelength, within=parameters.launch_na
    )


def collection_modes(parameters: Parameters) -> int:
    """Modes of the collecting fibre, one polarisation: 129 at the defaults."""
    return fibre.mode_count(parameters.collection_core_m / 2, parameters.collection_na, _wavelength_m(parameters))


def delay_spread_s(parameters: Parameters) -> float:
    """Modal delay spread of the launched aperture (s), 0.40 ns at the defaults."""
    return fibre.delay_spread(
        parameters.fibre_length_m, parameters.launch_na, parameters.fibre_index**2 / parameters.fibre_group_index
    )


def grain_superpixels(parameters: Parameters) -> float:
    """Speckle grain on the mirrors, intensity FWHM in superpixels."""
    superpixel_m = parameters.image_side * parameters.core_diameter_m / mirrors.SIDE
    return (
        fibre.speckle_grain(parameters.launch_na, _wavelength_m(parameters), parameters.launch_profile) / superpixel_m
    )


def mode_density_per_hz(parameters: Parameters) -> float:
    """Weyl density of the stadium's resonances (1/Hz), 0.99 per GHz at the defaults."""
    return cavity.weyl_density(
        radius=parameters.stadium_radius_m,
        straight=parameters.stadium_straight_m,
        index=parameters.chip_index,
        group_index=parameters.chip_group_index,
        wavelength=_wavelength_m(parameters),
    )


def _wavelength_m(parameters: Parameters) -> float:
    return parameters.design_wavelength_nm * 1e-9
