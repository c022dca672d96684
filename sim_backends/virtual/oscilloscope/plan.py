"""What one acquisition samples and when, planned from the settings once they have changed."""

import math
import struct
from dataclasses import dataclass, replace

from sim_backends.virtual.oscilloscope.horizontal import Horizontal
from sim_backends.virtual.oscilloscope.modes import BASE_RATE, Mode
from sim_backends.virtual.oscilloscope.trigger import Trigger
from sim_backends.virtual.oscilloscope.vertical import Channel, Vertical
from sim_backends.world.signals import Acquisition, TriggerCondition

OVERSAMPLED_AT_MOST = 64  # bounds the work; the real digitiser never slows down
REARM_S = 10e-6  # recalled: dead time between the acquisitions of an average
FRAME_REARM_S = 3e-6  # recalled: dead time between the frames of FastFrame


@dataclass(frozen=True, eq=False)
class Plan:
    """One acquisition as its settings were when it began.

    Attributes:
        acquisition: The samples that clients get.
        sampled: What the digitiser samples: every interval's samples lie around the point that they become.
        trigger_sample: Index of the sample at the trigger.
        verticals: One a channel.
        verticals_key: Names what the digitiser's noise depends on.
        mode: The mode really used.
        triggers: How many the acquisition wants.
        aligned: Samples are interpolated to the trigger, so that its sub-sample time is 0.
        condition: The edge that triggers; None: either edge, or the mains.
        spacing_s: Least time between two triggers.
        pointwise: Whether it is one record of which every point becomes a code by itself, without those around it.
    """

    acquisition: Acquisition
    sampled: Acquisition
    trigger_sample: int
    verticals: tuple[Vertical, ...]
    verticals_key: bytes
    mode: str
    triggers: int
    aligned: bool
    condition: TriggerCondition | None
    spacing_s: float
    pointwise: bool

    @property
    def enveloped(self) -> bool:
        """Whether points are lowest and highest codes in turn."""
        return self.mode in ("PEAKdetect", "ENVelope")


def planned(
    channels: dict[int, Channel], horizontal: Horizontal, trigger: Trigger, mode: Mode, frames: int | None
) -> Plan:
    """The plan for the present settings; `frames` of FastFrame, None without it."""
    rate, at = horizontal.sample_rate, horizontal.trigger_sample
    actual = mode.actual(rate, frames=frames is not None)
    selected = [number for number, channel in channels.items() if channel.selected]
    verticals = tuple(channels[number].vertical for number in selected)
    points = Acquisition(tuple(selected), rate, horizontal.record_length, -at / rate)
    triggers = mode.triggers(actual) if frames is None else frames
    plain = actual == "SAMple" and triggers == 1 and not mode.synchronous
    return Plan(
        acquisition=points,
        sampled=_oversampled(points) if actual in ("HIRes", "PEAKdetect") else points,
        trigger_sample=at,
        verticals=verticals,
        verticals_key=b"".join(struct.pack("<3d?", *vertical[:4]) for vertical in verticals),
        mode=actual,
        triggers=triggers,
        aligned=mode.synchronous,
        condition=trigger.condition,
        spacing_s=trigger.spacing(horizontal.duration_s + (REARM_S if frames is None else FRAME_REARM_S)),
        pointwise=plain and all(one.deskew_s == 0 and one.limit_hz == math.inf for one in verticals),
    )


def _oversampled(points: Acquisition) -> Acquisition:
    factor = min(round(BASE_RATE / points.sample_rate), OVERSAMPLED_AT_MOST)
    if factor == 1:
        return points
    rate = points.sample_rate * factor
    start_s = points.start_s - (factor - 1) / 2 / rate
    return replace(points, sample_rate=rate, samples=points.samples * factor, start_s=start_s)
