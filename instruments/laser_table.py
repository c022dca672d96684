"""The laser's command table: which commands it must have, and where it says that the laser can be set."""

import re
from pathlib import Path
from typing import ClassVar

from instruments.command_table import CommandTable
from instruments.driver import LaserRanges
from instruments.toml_files import read_toml

DEFAULT_TABLE = Path(__file__).with_name("alnair_tlg220.toml")


class LaserTable(CommandTable):
    """The laser's commands as its operator knows them."""

    INSTRUMENT = "laser"
    NEEDED: ClassVar = {
        name: tuple(re.compile(entry.get("reply", "")).groupindex)
        for name, entry in read_toml(DEFAULT_TABLE)["commands"].items()
    }
    OTHERWISE = ", or use the driver 'manual-laser'"

    def ranges(self) -> LaserRanges:
        """What wavelength and power can be set to."""
        return LaserRanges(self.range("wavelength"), self.range("power"), self.source, key="commands")
