"""How large a run is: shots, passes, ports and samples, fixed before its first shot."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

MOST_TRACES = 100_000
"""Ports of all passes together: a scan of 5000 wavelengths on 14 ports has 70 000."""
MOST = 1 << 40
"""Shots, samples, or the number of a port."""


@dataclass(frozen=True)
class RunShape:
    """The size of a run.

    Attributes:
        shots: number of planned shots.
        passes: the ports of each pass, for example ((2, 3, 4, 5), (6,)). `/frames` has its ports in this order.
        samples: samples of one frame.
        sample_interval_s: time between two samples, s.
        code_type: type of a digitiser code, "int16" when frames are averages.
        start_s: time of the first sample relative to the trigger, s; 0 where each frame has a place of its own in a
            record, as sequences do, and of bursts and scenes that labctl 0.1 measured.
        wavelengths_nm: laser wavelength of each pass; empty where the run does not say.

    Raises:
        ValueError: no run has such a size.
    """

    shots: int
    passes: tuple[tuple[int, ...], ...]
    samples: int
    sample_interval_s: float
    code_type: Literal["int8", "int16"] = "int8"
    start_s: float = 0.0
    wavelengths_nm: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        traces = sum(map(len, self.passes))
        if traces > MOST_TRACES:
            raise ValueError(f"{traces} ports in {len(self.passes)} passes: a run has at most {MOST_TRACES}")
        if self.shots < 1 or self.samples < 1 or not self.passes or not all(self.passes):
            size = f"{self.shots} shots of {self.samples} samples in {len(self.passes)} passes"
            raise ValueError(f"{size}: a run needs at least one shot, one sample and one port in each pass")
        if len(self.wavelengths_nm) not in (0, len(self.passes)):
            raise ValueError(f"{len(self.wavelengths_nm)} wavelengths: give one for each pass, or none")
        if len(set(zip(self.ports, self.wavelength_of_port, strict=True))) < traces:
            raise ValueError("a port is measured in more than one pass of the same wavelength")
        if self.code_type not in ("int8", "int16"):
            raise ValueError(f"code_type {str(self.code_type)[:80]}: is int8 or int16")

    @property
    def ports(self) -> tuple[int, ...]:
        """Ports in the order of `/frames`."""
        return tuple(port for ports in self.passes for port in ports)

    @property
    def pass_of_port(self) -> NDArray[np.int64]:
        """The pass that measures each entry of `ports`."""
        return np.repeat(np.arange(len(self.passes)), [len(ports) for ports in self.passes])

    @property
    def wavelength_of_port(self) -> tuple[float, ...]:
        """Wavelength in nm of each entry of `ports`, 0 where the run does not say."""
        wavelengths = self.wavelengths_nm or (0.0,) * len(self.passes)
        return tuple(wavelengths[index] for index in self.pass_of_port)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of `/frames`, little-endian."""
        return np.dtype(self.code_type).newbyteorder("<")

    @property
    def shot_bytes(self) -> int:
        """Bytes of the codes of one shot on all ports."""
        return len(self.ports) * self.samples * self.dtype.itemsize

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample, s, shape (samples,): the first at `start_s`."""
        return self.start_s + self.sample_interval_s * np.arange(self.samples, dtype=np.float64)

    def columns(self, pass_index: int) -> slice:
        """Where the ports of a pass lie on the port axis of `/frames`."""
        first, end = self._ends[pass_index : pass_index + 2]
        return slice(first, end)

    @cached_property
    def _ends(self) -> tuple[int, ...]:
        """Where each pass begins on the port axis, and the last one ends."""
        return tuple(accumulate(map(len, self.passes), initial=0))

    def to_json(self) -> dict[str, Any]:
        """The entry `shape` of the manifest."""
        return asdict(self) | {"passes": [list(ports) for ports in self.passes]}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "RunShape":
        """The inverse of `to_json`; keys of later minor versions are ignored.

        Raises:
            ValueError, TypeError, KeyError: the entries are not those of a run.
        """
        whole = [values["shots"], values["samples"], *(port for ports in values["passes"] for port in ports)]
        if not all(type(number) is int and 0 <= number <= MOST for number in whole):
            raise ValueError("shots, samples and ports are whole numbers")
        known = {name: values[name] for name in cls.__dataclass_fields__ if name in values}
        passes = tuple(tuple(ports) for ports in values["passes"])
        wavelengths = tuple(values.get("wavelengths_nm", ()))
        numbers = (known["sample_interval_s"], known.get("start_s", 0.0), *wavelengths)
        if not all(type(number) in (int, float) and abs(number) < math.inf for number in numbers):
            raise ValueError("times and wavelengths are numbers")
        return cls(**known | {"passes": passes, "wavelengths_nm": wavelengths})
