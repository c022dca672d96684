"""Frames that are the mean of several triggers, made of acquisitions of one trigger each."""

from collections.abc import Sequence

import numpy as np

from instruments.values import Frames, Scaling


def averaged(acquisitions: Sequence[Frames], finer: int) -> Frames:
    """The mean of acquisitions of the same shots, int16, in codes so many times as fine; a single one as it is."""
    if len(acquisitions) == 1:
        return acquisitions[0]
    total = np.sum([frames.codes for frames in acquisitions], axis=0, dtype=np.int32)
    codes = np.rint(total * (finer / len(acquisitions))).astype(np.int16)
    offsets_s = np.mean([frames.trigger_offset_s for frames in acquisitions], axis=0)
    clipped = np.any([frames.clipped for frames in acquisitions], axis=0)
    return Frames(codes, offsets_s, acquisitions[-1].time_s, clipped)


def rescaled(scalings: Sequence[Scaling], factor: float) -> tuple[Scaling, ...]:
    """What codes mean of which each is worth so many times as much."""
    return tuple(Scaling(scaling.scale_v * factor, scaling.offset_v) for scaling in scalings)
