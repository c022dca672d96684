"""Mathematical and reference waveforms of the virtual oscilloscope.

Source: tm_devices 3.7, descriptions of MATH<x>:DEFine, MATH<x>:VERTical:SCAle (autoscaling to 6 divisions around the
middle), DATa:ENCdg (floating point of mathematical waveforms only). An expression is made of channels, references,
numbers, `+ - * /` and parentheses; the functions of the real instrument are refused with -221.
"""

import ast
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import boolean, quoted
from sim_backends.scpi.commands import Setting
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.oscilloscope.transfer import CODES_PER_DIVISION, Trace
from sim_backends.virtual.oscilloscope.vertical import CHANNELS, Vertical

SHOWN_DIVISIONS = 6
LARGEST = 9.9e37  # single precision holds it
LONGEST_EXPRESSION = 200  # characters; the manual: "100 plus"

WAVEFORM_COMMANDS = (
    Setting("SELect:MATH#", "math#.selected", boolean),
    Setting("SELect:REF#", "references#.selected", boolean),
    Setting("MATH#:DEFine", "math#.definition", quoted),
    Setting("MATH#:UNITString", "math#.unit", quoted),
    Setting("MATH#:LABel:NAMe", "math#.label", quoted, effect=False),
    Setting("REF#:LABel:NAMe", "references#.label", quoted, effect=False),
)

_OPERATIONS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


@dataclass
class Reference:
    """A stored waveform."""

    selected: bool = False
    label: str = ""
    trace: Trace | None = None


@dataclass
class Math:
    """A waveform that is computed from others."""

    selected: bool = False
    unit: str = "V"
    label: str = ""
    _definition: str = ""
    _expression: ast.expr | None = field(default=None, repr=False)

    @property
    def definition(self) -> str:
        """The expression; -221 when set to one that is not simulated, "" for none."""
        return self._definition

    @definition.setter
    def definition(self, text: str) -> None:
        self._expression = _parsed(text) if text.strip() else None
        self._definition = text

    def trace(self, acquired: Callable[[str], Trace]) -> Trace:
        """The waveform, of what `acquired` gives for the sources in the expression; 2241 without an expression."""
        if self._expression is None:
            raise ScpiError(2241, "no expression")
        traces = {name: acquired(name) for name in dict.fromkeys(_names(self._expression))}
        frames = min(trace.codes.shape[0] for trace in traces.values())
        samples = min(trace.codes.shape[1] for trace in traces.values())
        values = {name: trace.physical()[:frames, :samples] for name, trace in traces.items()}
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            found = np.asarray(_value(self._expression, values), np.float64)
        finite = np.clip(np.nan_to_num(found, posinf=0.0, neginf=0.0), -LARGEST, LARGEST)
        return computed(finite, next(iter(traces.values())), self.unit)


def computed(values: NDArray[np.float64], like: Trace, unit: str) -> Trace:
    """A waveform of `values` (frames, samples), sampled like another, scaled to cover 6 divisions."""
    low, high = float(values.min()), float(values.max())
    middle, scale = (low + high) / 2, max((high - low) / SHOWN_DIVISIONS, 1e-12)
    codes = np.rint((values - middle) * (256 * CODES_PER_DIVISION / scale)).astype(np.int16)
    vertical = Vertical(scale, middle, 0.0, inverted=False)
    return Trace(0, codes, like.plan, vertical, like.times_s, like.offsets_s, values=values, unit=unit)


def _parsed(text: str) -> ast.expr:
    try:
        expression = ast.parse(text[: LONGEST_EXPRESSION + 1].strip().upper(), mode="eval").body
        supported = len(text) <= LONGEST_EXPRESSION and all(_simulated(node) for node in ast.walk(expression))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ScpiError(-221, f"no expression: {text[:40]}") from None
    if not (supported and any(_names(expression))):
        raise ScpiError(-221, f"not simulated: {text[:40]}")
    return expression


def _simulated(node: ast.AST) -> bool:
    if isinstance(node, ast.Name):
        return node.id in CHANNELS or node.id in {f"REF{number}" for number in (1, 2, 3, 4)}
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    return isinstance(node, (ast.BinOp, ast.UnaryOp, ast.USub, ast.expr_context, *_OPERATIONS))


def _names(expression: ast.expr) -> Iterator[str]:
    return (node.id for node in ast.walk(expression) if isinstance(node, ast.Name))


def _value(node: ast.expr, values: Mapping[str, NDArray[np.float64]]) -> Any:
    if isinstance(node, ast.BinOp):
        return _OPERATIONS[type(node.op)](_value(node.left, values), _value(node.right, values))
    if isinstance(node, ast.UnaryOp):
        return -_value(node.operand, values)
    return values[node.id] if isinstance(node, ast.Name) else np.float64(node.value)  # type: ignore[attr-defined]
