"""What an oscilloscope of the family is beside its acquisition system: how it replies, its events, its front panel."""

from collections.abc import Mapping
from typing import Any

from sim_backends.scpi.status import EventStatus, ScpiError
from sim_backends.virtual.instrument import VirtualInstrument
from sim_backends.world.world import World


class Oscilloscope(VirtualInstrument):
    """Replies in long words, a queue of events, and a front panel that can be locked."""

    DEFAULT_SUFFIX = None

    def __init__(self, world: World, section: Mapping[str, Any] | None = None) -> None:
        super().__init__(world, section)
        self.status: EventStatus = EventStatus()
        self.verbose = True
        self.clears_at_power_on = True
        self.display_on = True
        self.panel_lock = "NONe"

    def restore_factory_settings(self) -> None:
        """`FACtory`: as `*RST`, and replies with headers and long words."""
        self.reset()
        self.headers = self.verbose = True

    def short_identity(self) -> str:
        """`ID?`: the identity without the serial number."""
        maker, model, _, firmware = self.IDENTITY.split(",")
        return f"{maker},{model},{firmware}"

    @property
    def pixel_maps(self) -> bool:
        """FastAcq is off and stays off: -221."""
        return False

    @pixel_maps.setter
    def pixel_maps(self, wanted: bool) -> None:
        if wanted:
            raise ScpiError(-221, "FastAcq and its pixel maps are not simulated")

    def unlock_panel(self, _word: str) -> None:
        """`UNLock ALL`."""
        self.panel_lock = "NONe"
