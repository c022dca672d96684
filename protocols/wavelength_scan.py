"""How fast the speckle forgets: the same images at many wavelengths, which is also how a bench measures its fibre."""

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, PositiveInt

from instruments.bench import Bench
from instruments.units import Nanometres, Seconds
from instruments.values import Drive
from protocols.base import Events, Images, Judgement, Measurement, Part, Pass, Shot
from protocols.image_readout import LONGEST_WINDOW_S, SHORTEST_WINDOW_S, ImageReadout
from protocols.settings import Binarisation, Classes, Ports, Wavelength

RESOLUTION_NM = 1e-6
"""Of a wavelength that is asked for."""


class WavelengthScan(Measurement[Images]):
    """Show a few images at wavelengths from `start` on, `step` apart, and record every port at each.

    The traces of an image at two wavelengths are as alike as the masks are. How far apart wavelengths must be for their
    correlation to fall to one half says how far the delays of the fibre's modes spread; a few times further apart they
    project independent masks. By default the fibre before the chip is measured, port 0, since the chip's resonances
    change with the wavelength too. The first image is shown twice at each wavelength: how much its traces differ is the
    receiver's noise.
    """

    name: ClassVar[str] = "wavelength-scan"
    judgement: ClassVar[Judgement] = Judgement.ITSELF

    dataset: str = "mnist-0-3"
    classes: Classes | None = None
    images: Annotated[PositiveInt, Field(le=1000)] = 8
    binarisation: Binarisation = "128"
    ports: Ports = (0,)
    window: Annotated[Seconds, Field(ge=SHORTEST_WINDOW_S, le=LONGEST_WINDOW_S)] = 4e-9
    start: Wavelength = 1550.0
    step: Annotated[Nanometres, Field(ge=RESOLUTION_NM, le=1)] = 0.002
    steps: Annotated[int, Field(ge=2, le=5000)] = 26

    @property
    def wavelengths(self) -> tuple[float, ...]:
        """Every wavelength of the scan, nm, ascending."""
        return tuple(np.round(self.start + self.step * np.arange(self.steps), 6).tolist())

    def shots(self, inputs: Images) -> Sequence[Shot]:
        """The images in a class-balanced random order, with a reference and a dark frame behind them."""
        return self._readout.shots(inputs)

    def passes(self, bench: Bench) -> tuple[Pass, ...]:
        """Every wavelength with every patching that the ports need."""
        return self._readout.passes(bench)

    def check(self, bench: Bench, inputs: Images) -> None:
        """The images must fit the DMD."""
        self._readout.check(bench, inputs)

    def drive(self, bench: Bench, inputs: Images) -> Drive:
        """The pseudorandom drive of an image readout with the same seed."""
        return self._readout.drive(bench, inputs)

    def sample_count(self, inputs: Images) -> int:
        """The window in samples of 40 ps."""
        return self._readout.sample_count(inputs)

    def duration_s(self, bench: Bench, shots: int) -> float:
        """Arm, transfer and settling times of real instruments, pass by pass."""
        return self._readout.duration_s(bench, shots)

    def acquire(self, bench: Bench, inputs: Images, parts: Sequence[Part]) -> Events:
        """An image readout at every wavelength."""
        return self._readout.acquire(bench, inputs, parts)

    @property
    def _readout(self) -> ImageReadout:
        return ImageReadout(
            seed=self.seed,
            image_seed=self.image_seed,
            order_seed=self.order_seed,
            drive_seed=self.drive_seed,
            averages=self.averages,
            dataset=self.dataset,
            classes=self.classes,
            images=self.images,
            binarisation=self.binarisation,
            ports=self.ports,
            window=self.window,
            wavelengths=self.wavelengths,
        )
