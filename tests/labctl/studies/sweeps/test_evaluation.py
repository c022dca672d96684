"""The figure of a sweep: its axis in order, whatever the units and the order of measurement."""

from typing import Any

import pytest

from labctl.studies.sweeps.evaluation import _figure, _repeated


def row(axis: str, value: str, accuracy: float, chance: float = 0.25) -> dict[str, Any]:
    return {axis: value, "accuracy": accuracy, "interval": [accuracy - 0.1, accuracy + 0.1], "chance": chance}


def test_values_of_several_units_of_one_kind_are_numbers() -> None:
    rows = [row("window", "2 ns", 0.9), row("window", "400 ps", 0.5), row("window", "0.8 ns", 0.7)]
    (axes,) = _figure(rows, {"window": ("400 ps", "0.8 ns", "2 ns")}).axes
    assert axes.get_xlabel() == "window (s)"
    curve = next(line for line in axes.lines if len(line.get_xdata()) == 3)
    assert curve.get_xdata() == pytest.approx([0.4e-9, 0.8e-9, 2e-9])
    assert curve.get_ydata() == pytest.approx([50, 70, 90])


def test_words_stand_in_the_order_in_which_they_were_given() -> None:
    rows = [row("ports", "2-5", 0.9), row("ports", "2", 0.4), row("ports", "2,3", 0.6)]
    (axes,) = _figure(rows, {"ports": ("2", "2,3", "2-4", "2-5")}).axes
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["2", "2,3", "2-5"]
    curve = next(line for line in axes.lines if len(line.get_xdata()) == 3)
    assert curve.get_ydata() == pytest.approx([40, 60, 90])


def test_words_that_return_side_by_side_have_one_place() -> None:
    rows = [row("ports", port, 0.5) | {"averages": n} for port, n in (("2", "1"), ("2-4", "1"), ("2-4", "4"))]
    (axes,) = _figure(rows, {"ports": ("2", "2-4", "2-4"), "averages": ("1", "1", "4")}).axes
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["2", "2-4"]


def test_chance_is_drawn_where_it_is_one() -> None:
    def drawn(*chances: float) -> bool:
        rows = [row("classes", "0,1", 0.9, chances[0]), row("classes", "0-3", 0.8, chances[1])]
        (axes,) = _figure(rows, {"classes": ("0,1", "0-3")}).axes
        return any("chance" in text.get_text() for text in axes.texts)

    assert drawn(0.5, 0.5)
    assert not drawn(0.5, 0.25)


def test_axes_that_go_side_by_side_make_one_curve() -> None:
    rows = [row("power", f"{number} mW", 0.1 * number) | {"window": f"{number} ns"} for number in (2, 1, 3)]
    over = {"power": ("1 mW", "2 mW", "3 mW"), "window": ("1 ns", "2 ns", "3 ns")}
    (axes,) = _figure(rows, over, zipped=True).axes
    assert axes.get_xlabel() == "power (mW), with window"
    curve = next(line for line in axes.lines if len(line.get_xdata()) == 3)
    assert curve.get_ydata() == pytest.approx([10, 20, 30])
    assert not any(len(line.get_xdata()) == 3 for line in _figure(rows, over).axes[0].lines)


class Looked(dict[str, Any]):
    """A row that counts how often it is looked at."""

    looks = 0

    def __getitem__(self, key: str) -> Any:
        Looked.looks += 1
        return super().__getitem__(key)


def test_the_point_that_was_measured_again_is_found_by_one_look_at_each_row() -> None:
    rows = [Looked(row("power", f"{number % 999} mW", 0.001 * number)) for number in range(1000)]
    assert _repeated(rows, ["power"]) == pytest.approx([0.0, 0.999])
    assert Looked.looks == 2 * len(rows)
    assert _repeated(rows[:999], ["power"]) == []
