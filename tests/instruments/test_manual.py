"""Instruments set by hand."""

import pytest

from instruments.errors import OutOfRange
from instruments.manual import ManualLaser, ManualPatchPanel


class Operator:
    def __init__(self) -> None:
        self.requests: list[str] = []

    def __call__(self, request: str) -> str:
        self.requests.append(request)
        return ""


def test_the_operator_is_asked_and_the_answer_recorded() -> None:
    operator = Operator()
    laser = ManualLaser(operator)
    laser.self_test()
    for _again in range(2):
        assert laser.set_power(0.03) == 0.03
        assert laser.tune(1550.0) == 1550.0
    assert len(operator.requests) == 2, "what is set already needs no hand"
    laser.emit()
    assert laser.settings() == {"power_w": 0.03, "wavelength_nm": 1550.0, "emitting": 1}
    laser.make_safe()
    laser.make_safe()
    assert operator.requests[-1].startswith("Switch the laser OFF")
    assert len(operator.requests) == 4
    assert laser.identify().model == "manual laser"
    laser.close()


def test_a_laser_that_was_never_lit_asks_nothing_on_the_way_out() -> None:
    operator = Operator()
    ManualLaser(operator).make_safe()
    assert not operator.requests


def test_fibres_are_moved_only_when_they_must() -> None:
    operator = Operator()
    panel = ManualPatchPanel(operator, ports=(2, 3))
    panel.connect({1: 2, 2: 3})
    panel.connect({1: 2, 2: 3})
    assert operator.requests == ["Connect port 2 to CH1, port 3 to CH2, and nothing else, then press Enter"]
    assert panel.settings() == {"ch1": 2, "ch2": 3}
    with pytest.raises(OutOfRange, match="port 9"):
        panel.connect({1: 9})
    panel.self_test()
    panel.make_safe()
    panel.close()
    assert panel.identify().model
