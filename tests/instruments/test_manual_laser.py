"""A laser set by hand."""

from instruments.manual_laser import ManualLaser


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


def test_the_operator_is_told_what_the_record_keeps() -> None:
    operator = Operator()
    laser = ManualLaser(operator)
    for wavelength_nm in (1550.0, 1550.002, 1550.004, 1550.006):
        laser.tune(wavelength_nm)
    for power_w in (0.03, 0.030000005):
        laser.set_power(power_w)
    told = [request.removeprefix("Set the laser to ").partition(",")[0] for request in operator.requests]
    assert told == ["1550 nm", "1550.002 nm", "1550.004 nm", "1550.006 nm", "30 mW", "30.000005 mW"]
