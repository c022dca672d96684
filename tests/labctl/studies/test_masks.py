"""What a readout needs to be the same."""

from typing import Any

import pytest

from labctl.studies.masks import Masks

HERE: dict[str, Any] = {
    "drive": "abc",
    "drive_seed": 1,
    "wavelengths_nm": (1550.0,),
    "sample_interval_s": 40e-12,
    "bench": "ours",
    "twin": None,
}
TWIN = {"twin_seed": 1, "parameters": {}}


@pytest.mark.parametrize(
    ("here", "there", "told"),
    [
        ({}, {"drive": "abd"}, "its drive is not that of this run: measure with --set drive_seed=1, or train anew"),
        ({"drive_seed": None}, {"drive": "abd"}, "its drive is not that of this run: measure, or train anew"),
        ({}, {"bench": "theirs"}, "it was trained on 'ours', and this run is of 'theirs': train anew"),
        ({}, {"twin": TWIN}, "it was trained on 'ours', and this run is of simulated bench 1: train anew"),
        (
            {"twin": TWIN},
            {"twin": {"twin_seed": 1, "parameters": {"enob": 4.0}}},
            "it was trained on simulated bench 1, and this run is of simulated bench 1 of changed parameters: "
            "train anew",
        ),
        ({}, {"wavelengths_nm": (1551.0,)}, "it was trained at 1550 nm, and this run is at 1551 nm: train anew"),
        (
            {"columns": ((2, 1550.0), (3, 1550.0))},
            {"columns": ((2, 1551.0), (3, 1550.0))},
            "it was trained on port 2 at 1550 nm, which this run does not hold: measure it, or train anew",
        ),
        (
            {"columns": ((3, 1550.0), (2, 1551.0))},
            {"columns": ((2, 1551.0), (3, 1551.0), (2, 1550.0), (3, 1550.0)), "wavelengths_nm": (1550.0, 1551.0)},
            None,
        ),
        ({}, {"sample_interval_s": 10e-12}, "its samples are 40 ps apart, here 10: train anew"),
        ({}, {"sample_interval_s": 40.000000001e-12}, None),
        ({"twin": TWIN}, {"twin": TWIN, "bench": "another name of the same twin"}, None),
        ({}, {"drive_seed": 2}, None),
    ],
)
def test_a_readout_knows_its_masks_and_says_which_are_others(
    here: dict[str, Any], there: dict[str, Any], told: str | None
) -> None:
    assert Masks(**HERE | here).unlike(Masks(**HERE | there)) == told
