from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.base import clone

from labctl.analysis.analogue import AnalogueReadout
from labctl.analysis.readouts import softmax_classifier
from labctl.errors import AnalysisError

PORTS, SAMPLES, CLASSES = 4, 6, 3
Shots = tuple[NDArray[np.float64], NDArray[np.int64]]


def light(shots: int, *, seed: int = 0) -> Shots:
    """Speckle that depends on the class, brighter on some ports than on others, around 1."""
    generator = np.random.default_rng(1)
    pattern = generator.exponential(size=(CLASSES, PORTS * SAMPLES))
    level = np.repeat(generator.uniform(0.5, 2.0, PORTS), SAMPLES)
    generator = np.random.default_rng((1, seed))
    labels = generator.integers(0, CLASSES, shots)
    return generator.gamma(3, 1 / 3, (shots, PORTS * SAMPLES)) * (1 + 0.5 * pattern[labels]) * level, labels


TRAINING, TEST = light(600), light(2000, seed=1)
DIGITAL = float(softmax_classifier().fit(*TRAINING).score(*TEST))


def accuracy(shots: Shots = TEST, **settings: Any) -> float:
    return float(AnalogueReadout(PORTS, **settings).fit(*TRAINING).score(*shots))


def test_fine_levels_and_no_defects_are_the_digital_readout() -> None:
    found = accuracy(bits=10, crosstalk=0.0, extinction_db=60.0, time_constant=np.inf)
    assert found == pytest.approx(DIGITAL, abs=0.003)


def test_what_is_known_in_training_costs_little() -> None:
    assert accuracy(bits=8, crosstalk=0.1, time_constant=3.0) == pytest.approx(DIGITAL, abs=0.01)


def test_fewer_levels_lose_more_and_training_with_them_loses_less_than_rounding() -> None:
    trained = {bits: accuracy(bits=bits) for bits in (1, 4)}
    rounded = accuracy(bits=1, sweeps=0)
    assert trained[4] > DIGITAL - 0.01
    assert rounded < trained[1] < trained[4] + 0.01


def test_what_it_computes_is_what_the_light_does() -> None:
    """Attenuators, crosstalk, detector pair and leaky integrator, one after the other and sample by sample."""
    readout = AnalogueReadout(PORTS, bits=3, crosstalk=0.05, extinction_db=15.0, time_constant=4.0).fit(*TRAINING)
    shot = TEST[0][:1].reshape(PORTS, SAMPLES)
    extinction = 10 ** (-15.0 / 10)
    levels = np.linspace(extinction, 1, 8)
    for place, settings in enumerate(readout.settings_.reshape(CLASSES, PORTS, SAMPLES)):
        charge = 0.0
        for sample in range(SAMPLES):
            difference = 0.0
            for arm in (1, -1):
                own = levels[np.maximum(arm * settings, 0)]
                for port in range(PORTS):
                    neighbours = [own[other, sample] for other in (port - 1, port + 1) if 0 <= other < PORTS]
                    neighbours += [own[port, sample - 1]] if sample else []
                    through = own[port, sample] + 0.05 * sum(one - own[port, sample] for one in neighbours)
                    difference += arm * through * shot[port, sample]
            charge = charge * np.exp(-1 / 4.0) + difference
        found = readout.decision_function(TEST[0][:1])[0, place]
        assert found == pytest.approx(readout.gain_[place] * charge + readout.threshold_[place])


def test_no_weight_is_beyond_the_attenuators() -> None:
    readout = AnalogueReadout(PORTS, bits=2).fit(*TRAINING)
    assert set(np.unique(readout.settings_)) <= set(range(-3, 4))
    assert readout.attenuations().min() >= 0.01 - 1e-12
    assert readout.attenuations().max() <= 1


def test_many_photons_are_as_good_as_any_and_few_are_not() -> None:
    assert accuracy(photons=1e7) == pytest.approx(accuracy(), abs=0.005)
    assert accuracy(photons=3.0) < accuracy(photons=300.0) - 0.05


def test_photons_are_shared_among_all_arms() -> None:
    """The mean of many measurements is that of strong light; their noise that of the photons behind the attenuators."""
    readout = AnalogueReadout(PORTS, bits=4, crosstalk=0.0, time_constant=np.inf, photons=500.0).fit(*TRAINING)
    shot = TEST[0][0]
    many = (readout.decision_function(np.tile(shot, (4000, 1))) - readout.threshold_) / readout.gain_
    adding, subtracting = readout.attenuations()
    assert many.mean(axis=0) == pytest.approx((adding - subtracting) @ shot, abs=0.1)
    share = 500.0 / (2 * CLASSES)
    assert many.var(axis=0) == pytest.approx((adding + subtracting) @ shot / share, rel=0.1)


def test_it_is_repeated_exactly_and_two_classes_will_do() -> None:
    readout = AnalogueReadout(PORTS, photons=50.0, seed=3)
    one, other = (clone(readout).fit(*TRAINING).predict(TEST[0]) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    two = TRAINING[1] < 2
    names = np.array(["zero", "one"])[TRAINING[1][two]]
    assert clone(readout).fit(TRAINING[0][two], names).score(TRAINING[0][two], names) > 0.8


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"ports": 5}, "24 features are not equally many samples on 5 ports"),
        ({"bits": 0}, "no readout has 0 bits"),
        ({"crosstalk": 0.4}, "a crosstalk of 0.4"),
        ({"photons": -1.0}, "photons cannot be counted"),
    ],
)
def test_what_cannot_be_built_is_an_error(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(AnalysisError, match=message):
        AnalogueReadout(**{"ports": PORTS, **settings}).fit(*TRAINING)


def test_one_class_is_nothing_to_tell_apart() -> None:
    with pytest.raises(AnalysisError, match="one class"):
        AnalogueReadout(PORTS).fit(TRAINING[0], np.zeros(len(TRAINING[0])))
