"""What goes up to the bench before anything is measured, told while it goes."""

from collections.abc import Callable
from functools import partial

from instruments.bench import Bench

Uploading = Callable[[str, int, int], None]
"""Called with what is uploaded, how much of it is there so far, and how much there is in all."""


def tell_uploads(bench: Bench, uploading: Uploading) -> None:
    """Have every upload of a waveform or of a DMD's pictures tell how far it is."""
    for instrument, what in ((bench.awg, "waveform"), (bench.dmd, "DMD patterns")):
        load = getattr(instrument, "load", None)  # a DMD that shows one picture at a time has none
        if load is not None:
            vars(instrument)["load"] = partial(load, progress=partial(uploading, what))
