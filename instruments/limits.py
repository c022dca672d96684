"""What must never be exceeded on a bench: compared before anything is sent, and again with what instruments answer."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instruments.errors import InstrumentError, OutOfRange
from instruments.values import Codes, Scaling

ROUNDING = 2e-3
"""By so much of a limit an answer may lie above it: powers are set in steps of 0.01 dB, amplitudes of a millivolt."""


class OverLimit(InstrumentError):
    """What an instrument answers or measures exceeds a limit of the station."""


@dataclass(frozen=True)
class Levels:
    """The optical and RF levels the bench works at; without an amplifier there is no amplified power."""

    optical_power_w: float
    rf_amplitude_vpp: float
    amplified_power_w: float = 0.0


@dataclass(frozen=True)
class Limits:
    """What must never be exceeded: light out of the laser, volts into the RF amplifier, volts out of a detector.

    And light out of the optical amplifier, where there is one.
    """

    optical_power_w: float
    rf_amplitude_vpp: float
    detector_v: float
    amplified_power_w: float = math.inf

    def check_levels(self, levels: Levels, source: str) -> None:
        """Compare what the file `source` asks for, before anything is sent.

        Raises:
            OutOfRange: a power or the RF amplitude exceeds its limit, or the laser's power is none.
        """
        if not levels.optical_power_w > 0:
            raise OutOfRange(
                f"{source}: laser.power = {levels.optical_power_w * 1e3:g} mW is no power of a laser: "
                f"choose one above 0"
            )
        if levels.optical_power_w > self.optical_power_w:
            raise OutOfRange(
                f"{source}: laser.power = {levels.optical_power_w * 1e3:g} mW exceeds limits.optical_power = "
                f"{self.optical_power_w * 1e3:g} mW: lower the power"
            )
        if levels.rf_amplitude_vpp > self.rf_amplitude_vpp:
            raise OutOfRange(
                f"{source}: awg.amplitude = {levels.rf_amplitude_vpp:g} V exceeds limits.rf_amplitude = "
                f"{self.rf_amplitude_vpp:g} V: lower the amplitude"
            )
        if levels.amplified_power_w > self.amplified_power_w:
            raise OutOfRange(
                f"{source}: amplifier.power = {levels.amplified_power_w * 1e3:g} mW exceeds limits.amplified_power = "
                f"{self.amplified_power_w * 1e3:g} mW: lower the power"
            )

    def check_power(self, answered_w: float) -> None:
        """Compare the optical power that the laser answers it gives.

        Raises:
            OverLimit: it is more, by more than its steps explain.
        """
        if _exceeds(answered_w, self.optical_power_w):
            raise OverLimit(
                f"laser: gives {answered_w * 1e3:.4g} mW, above limits.optical_power = "
                f"{self.optical_power_w * 1e3:g} mW: lower laser.power, or check its front panel"
            )

    def check_measured_power(self, measured_w: float) -> None:
        """Compare the optical power that the power meter sees leave the laser.

        Raises:
            OverLimit: it is more, by more than the laser's steps explain.
        """
        if _exceeds(measured_w, self.optical_power_w):
            raise OverLimit(
                f"power_meter: the laser gives {measured_w * 1e3:.4g} mW, above limits.optical_power = "
                f"{self.optical_power_w * 1e3:g} mW: lower laser.power, or correct power_meter.tap"
            )

    def check_amplified_power(self, answered_w: float) -> None:
        """Compare the optical power that the amplifier answers it gives.

        Raises:
            OverLimit: it is more, by more than its steps explain.
        """
        if _exceeds(answered_w, self.amplified_power_w):
            raise OverLimit(
                f"amplifier: gives {answered_w * 1e3:.4g} mW, above limits.amplified_power = "
                f"{self.amplified_power_w * 1e3:g} mW: lower amplifier.power, or check its front panel"
            )

    def check_amplitude(self, answered_vpp: float) -> None:
        """Compare the amplitude that the AWG is about to be sent, or answers.

        Raises:
            OverLimit: it is more, by more than its steps explain.
        """
        if _exceeds(answered_vpp, self.rf_amplitude_vpp):
            raise OverLimit(
                f"awg: amplitude {answered_vpp:.4g} V is above limits.rf_amplitude = {self.rf_amplitude_vpp:g} V: "
                f"lower awg.amplitude"
            )

    def check_detector(self, channel: int, volts: float) -> None:
        """Compare what an oscilloscope channel has shown of its detector.

        Raises:
            OverLimit: it is more.
        """
        if not abs(volts) <= self.detector_v:
            raise OverLimit(
                f"scope: CH{channel} shows {volts:.3g} V, above limits.detector = {self.detector_v:g} V: lower the "
                f"laser's power or the optical amplifier's gain, or attenuate the light before that detector"
            )

    def detector_codes(self, scalings: Sequence[Scaling]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The lowest and the highest code of each channel that the detectors may give, each of shape (channels,)."""
        scale = np.array([scaling.scale_v for scaling in scalings])
        offset = np.array([scaling.offset_v for scaling in scalings])
        return (-self.detector_v - offset) / scale, (self.detector_v - offset) / scale

    def check_traces(self, channels: Sequence[int], codes: Codes, scalings: Sequence[Scaling]) -> None:
        """Compare the largest volts of traces, codes of shape (..., channels, samples).

        A trace that leaves its range is seen as far as the range goes.

        Raises:
            OverLimit: one is more than a detector may give; the message names the first such channel.
        """
        others = (*range(codes.ndim - 2), codes.ndim - 1)
        ends = zip(codes.min(axis=others).tolist(), codes.max(axis=others).tolist(), strict=True)
        for channel, scaling, (low, high) in zip(channels, scalings, ends, strict=True):
            volts = (scaling.scale_v * low + scaling.offset_v, scaling.scale_v * high + scaling.offset_v)
            self.check_detector(channel, max(volts, key=abs))


def _exceeds(answered: float, limit: float) -> bool:
    """By more than the instrument's steps explain; what is no number does."""
    return not answered <= limit * (1 + ROUNDING)
