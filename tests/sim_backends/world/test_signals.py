import numpy as np
import pytest

from sim_backends.world.signals import Playback


def test_playback_needs_a_marker_of_its_length() -> None:
    with pytest.raises(ValueError, match="equally long"):
        Playback(np.zeros(4, np.float32), np.zeros(3, bool), 0.0, 1.0, 25e9)


def test_playback_is_named_by_its_content() -> None:
    volts = np.linspace(-0.25, 0.25, 8, dtype=np.float32)
    marker = np.arange(8) < 4
    one = Playback(volts, marker, 0.0, 1.0, 25e9)
    assert one.period == pytest.approx(0.32e-9)
    assert one.digest == Playback(volts.copy(), marker.copy(), 0.0, 1.0, 25e9).digest
    others = [
        Playback(volts[::-1].copy(), marker, 0.0, 1.0, 25e9),
        Playback(volts, ~marker, 0.0, 1.0, 25e9),
        Playback(volts, marker, 0.0, 1.2, 25e9),
        Playback(volts, marker, 0.0, 1.0, 12.5e9),
    ]
    assert one.digest not in {other.digest for other in others}
