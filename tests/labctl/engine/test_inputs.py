"""What a protocol takes is loaded by what it says of itself."""

from typing import ClassVar

import numpy as np
import pytest

from labctl.engine.inputs import inputs_for
from protocols.base import Images, ProtocolError, Sequences
from protocols.image_readout import ImageReadout
from protocols.sequence_readout import SequenceReadout
from tests.data_sets import require


class Misdeclared(ImageReadout):
    """It says that it takes sequences, and has the settings of images."""

    takes: ClassVar[type[Images | Sequences]] = Sequences


def test_images_are_loaded_for_who_shows_them() -> None:
    inputs = inputs_for(ImageReadout(images=8))
    assert isinstance(inputs, Images)
    assert inputs.images.shape == (8, 28, 28)


def test_all_images_are_those_that_the_set_has_of_the_classes() -> None:
    inputs = inputs_for(ImageReadout(images="all", classes=(1, 3)))
    assert isinstance(inputs, Images)
    assert np.unique_counts(inputs.labels).counts.tolist() == [1000, 1000]


def test_a_stretch_is_loaded_for_who_plays_it() -> None:
    require("santa-fe")
    inputs = inputs_for(SequenceReadout(symbols=50))
    assert isinstance(inputs, Sequences)
    assert inputs.values.shape == (1, 50)
    with pytest.raises(ProtocolError, match=r"symbols = 99999: the sequences of 'santa-fe' have \d+: ask for fewer"):
        inputs_for(SequenceReadout(symbols=99999))


def test_a_protocol_that_lacks_a_setting_hears_which() -> None:
    with pytest.raises(ProtocolError, match="takes sequences, but has no setting 'symbols': give it dataset, classes"):
        inputs_for(Misdeclared())
